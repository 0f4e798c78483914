"""Simulators that move bodies of a scene: MuJoCo, MuJoCo Warp, Newton. Imported only when a scene asks for one."""

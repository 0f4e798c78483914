"""The public names of ``tactemu.envs``, which editors, type checkers and ``__init__.py`` read."""

from tactemu.envs.env import SkinEnv as SkinEnv
from tactemu.envs.hand import HandEnv as HandEnv
from tactemu.envs.hand import HandTask as HandTask
from tactemu.envs.hand import HandVectorEnv as HandVectorEnv
from tactemu.envs.press import PressEnv as PressEnv
from tactemu.envs.press import PressTask as PressTask
from tactemu.envs.press import PressVectorEnv as PressVectorEnv
from tactemu.envs.task import SkinTask as SkinTask
from tactemu.envs.vector_env import SkinVectorEnv as SkinVectorEnv

__all__: list[str]

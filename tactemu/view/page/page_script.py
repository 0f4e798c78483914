"""The script of the page, which runs before viser's: it corrects listeners, and spares a browser without a GPU work.

A processor draws each pixel itself. Without a GPU the canvas therefore has no anti-aliasing (four samples a pixel), is
opaque (else the browser mixes it with the background of the page for each frame), and is not kept for a later read.
"""

from __future__ import annotations

from tactemu.base.style import THEMES, rgb

SCHEME = "tactemu.scheme"
"""The key under which a browser stores its colour scheme, ``light`` or ``dark``."""
_PREFIX = "viser-user:"
"""The prefix that viser's page puts before keys of applications."""


def _sky(k: int) -> str:
    """Return the colour of an opaque canvas, between those of the gradient; 0: of a light page, 1: of a dark one."""
    return ", ".join(f"{part:.4f}" for part in (rgb(THEMES["sky"][k]) + rgb(THEMES["haze"][k])) / 2)


_SCHEME = f"""
localStorage.setItem("{_PREFIX}{SCHEME}", matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
"""
_LISTENERS = """
const listen = EventTarget.prototype.addEventListener;
EventTarget.prototype.addEventListener = function (type, heard, how) {
  const stops = type.startsWith("pointer") && how && how.passive;
  return listen.call(this, type, heard, stops ? {...how, passive: false} : how);
};
"""
"""Declares viser's pointer listeners not passive: they stop events, which passive listeners may not."""

_WITHOUT_GPU = f"""
const context = HTMLCanvasElement.prototype.getContext;
const drawer = () => {{
  const gl = context.call(document.createElement("canvas"), "webgl2");
  const about = gl && gl.getExtension("WEBGL_debug_renderer_info");
  const name = about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}};
if (/swiftshader|llvmpipe|softpipe|software|basic render/i.test(drawer())) {{
  const sky = {{light: [{_sky(0)}], dark: [{_sky(1)}]}};
  HTMLCanvasElement.prototype.getContext = function (kind, how) {{
    if (kind !== "webgl2" || !how) return context.call(this, kind, how);
    const gl = context.call(this, kind, {{...how, antialias: false, alpha: false, preserveDrawingBuffer: false}});
    if (!gl) return gl;
    const clear = gl.clear.bind(gl);
    gl.clear = (what) => {{
      const isCanvas = what & gl.COLOR_BUFFER_BIT && !gl.getParameter(gl.DRAW_FRAMEBUFFER_BINDING);
      const scheme = document.documentElement.getAttribute("data-mantine-color-scheme");
      const kept = isCanvas && gl.getParameter(gl.COLOR_CLEAR_VALUE);
      if (kept) gl.clearColor(...(sky[scheme] ?? sky.light), 1);
      clear(what);
      if (kept) gl.clearColor(...kept);
    }};
    return gl;
  }};
  const wait = setInterval(() => {{
    const image = window.__viserMutable?.backgroundMaterial;
    if (image) {{ image.visible = false; clearInterval(wait); }}
  }}, 200);
}}
"""
"""Gives canvases of a browser without a GPU the attributes that cost least, and its page's background.

viser's image behind the scene, which the page does not use, is not drawn: it would test every pixel of each frame.
"""

SCRIPT = f"{_SCHEME}{_LISTENERS}{_WITHOUT_GPU}"
"""The script, which the page's head contains."""

"""The process's one OpenGL context, by way of pyrender; what is odd about that library stays here and in ``gl``."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
import warnings
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError

PACKAGES = "libegl1 libgl1 libgles2 libegl-mesa0 libgl1-mesa-dri"
"""Debian packages of the software renderer."""
BACKGROUND = (0.80, 0.86, 0.93, 1.0)
"""Colour where nothing is hit."""


def _import_pyrender() -> ModuleType:
    """Import pyrender with its compatibility shims in place.

    - Without PYOPENGL_PLATFORM it looks for a screen.
    - Its viewer, which nobody uses here, is built on a pyglet window, and pyglet looks for the libraries of a screen
      (X11, GLU) unless it is told that there is none.
    - PyOpenGL 3.1.0 has no array handler for ``ctypes.byref`` results under the type name of Python >= 3.12.
    - numpy 2 has no ``infty``: only ``Mesh.bounds`` asks for it, which nothing here needs.
    """
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from OpenGL.plugins import FormatHandler

        reference = type(ctypes.byref(ctypes.c_int()))
        name = f"{reference.__module__}.{reference.__name__}"
        if FormatHandler.by_name("galoc-ctypes-reference") is None:
            FormatHandler(
                "galoc-ctypes-reference", "OpenGL.arrays.ctypesparameters.CtypesParameterHandler", [name], isOutput=True
            )
        import pyglet

        if "pyglet.window" not in sys.modules:
            pyglet.options["headless"], pyglet.options["shadow_window"] = True, False
        import pyrender
        import pyrender.renderer
    return pyrender


def _renderer_class(pyrender: ModuleType) -> type:
    """Pyrender's renderer, changed where it is slow, random or forgetful."""
    from OpenGL import GL

    seg, flat = pyrender.constants.RenderFlags.SEG, pyrender.constants.RenderFlags.FLAT
    use_material = pyrender.constants.ProgramFlags.USE_MATERIAL

    class LeanRenderer(pyrender.renderer.Renderer):  # type: ignore[name-defined]
        def _update_context(self, scene: Any, flags: int) -> None:
            # Upstream deletes the meshes of every other scene here; ours stay until they are released.
            for mesh in scene.meshes:
                for primitive in mesh.primitives:
                    if not primitive._in_context():
                        primitive._add_to_context()
                        for texture in primitive.material.textures:
                            texture._add_to_context()

        def _forward_pass(self, scene: Any, flags: int, seg_node_map: Any = None) -> Any:
            """Draw texture * vertex colour (FLAT), or vertex colour alone into one sample (SEG).

            Upstream spends 0.3 ms of Python on each mesh, in an order hashed by address, and has one colour for each
            node in SEG.
            """
            self._configure_forward_pass_viewport(flags)
            GL.glClearColor(*((0.0, 0.0, 0.0, 0.0) if flags & seg else BACKGROUND))
            GL.glClear(GL.GL_COLOR_BUFFER_BIT | GL.GL_DEPTH_BUFFER_BIT)
            for state, on in ((GL.GL_MULTISAMPLE, not flags & seg), (GL.GL_BLEND, False), (GL.GL_CULL_FACE, True)):
                (GL.glEnable if on else GL.glDisable)(state)
            GL.glCullFace(GL.GL_BACK)
            GL.glPolygonMode(GL.GL_FRONT_AND_BACK, GL.GL_FILL)
            GL.glActiveTexture(GL.GL_TEXTURE0)
            matrices = self._get_camera_matrices(scene)
            bound = None
            for mesh in sorted(scene.meshes, key=lambda m: m.name):
                for primitive in mesh.primitives:
                    bound = self._bind_flat_program(primitive, bound, matrices)
                    for texture in primitive.material.textures:
                        texture._bind()
                    primitive._bind()
                    GL.glDrawElementsInstanced(
                        GL.GL_TRIANGLES, primitive.indices.size, GL.GL_UNSIGNED_INT, ctypes.c_void_p(0), 1
                    )
            GL.glBindVertexArray(0)
            return self._read_main_framebuffer(scene, flags)

        def _bind_flat_program(self, primitive: Any, bound: Any, matrices: tuple) -> Any:
            """Bind the program for a primitive, and set what all its primitives share when that changes."""
            key = (primitive.buf_flags, primitive.material.tex_flags)
            program = self._flat_programs.get(key)
            if program is None:
                program = self._get_primitive_program(primitive, flat, use_material)
                self._flat_programs[key] = program
            if program is not bound:
                program._bind()
                values = {"V": matrices[0], "P": matrices[1], "M": np.eye(4), "material.base_color_factor": np.ones(4)}
                for name, value in values.items():
                    program.set_uniform(name, value)
                program.set_uniform("material.base_color_texture", 0)
            return program

        @cached_property
        def _flat_programs(self) -> dict:
            return {}

        def _configure_forward_pass_viewport(self, flags: int) -> None:
            super()._configure_forward_pass_viewport(flags)
            if flags & seg:
                # Straight into the plain buffer: one sample, at the pixel's centre.
                GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, self._main_fb)

        def _read_main_framebuffer(self, scene: Any, flags: int) -> Any:
            width, height = self._main_fb_dims
            GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
            if flags & seg:
                GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._main_fb)
                code = GL.glReadPixels(0, 0, width, height, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE)
                depth = GL.glReadPixels(0, 0, width, height, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT)
                return _image(code, "<u4", (height, width)), _image(depth, np.float32, (height, width))
            GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._main_fb_ms)
            GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, self._main_fb)
            GL.glBlitFramebuffer(
                0, 0, width, height, 0, 0, width, height, GL.GL_COLOR_BUFFER_BIT, GL.GL_LINEAR
            )  # upstream also resolves and converts a depth that nobody reads
            GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._main_fb)
            colour = GL.glReadPixels(0, 0, width, height, GL.GL_RGB, GL.GL_UNSIGNED_BYTE)
            return _image(colour, np.uint8, (height, width, 3))

    return LeanRenderer


def _image(raw: Any, dtype: Any, shape: tuple[int, ...]) -> NDArray:
    """GL's bytes (bottom row first) as an image."""
    return np.frombuffer(raw, dtype).reshape(shape)[::-1]


@dataclass(slots=True)
class Context:
    """The process's one GL context. Deleting it would end EGL for everyone, so it lives until the process ends."""

    pyrender: ModuleType
    offscreen: Any
    pid: int
    thread: int
    released: list
    """Meshes whose GL objects await deletion in the context's thread."""

    @property
    def usable(self) -> bool:
        """Whether this process and thread may call GL."""
        return self.pid == os.getpid() and self.thread == threading.get_ident()

    def draw(self, scene: Any, width: int, height: int, flags: int) -> Any:
        """Colours (H, W, 3), or with ``flags`` SEG the vertex colours as numbers and the depth buffer, both (H, W)."""
        self.offscreen.viewport_width, self.offscreen.viewport_height = width, height
        self.sweep()
        return self.offscreen.render(scene, flags)

    def sweep(self) -> None:
        """Delete the GL objects of released meshes."""
        self.offscreen._platform.make_current()
        while self.released:
            mesh = self.released.pop()
            for primitive in mesh.primitives:
                primitive.delete()
                for texture in primitive.material.textures:
                    texture.delete()


_context: Context | None = None


def get_context() -> Context:
    """The context, made on first use. A context works in the process and the thread that made it only."""
    global _context
    if _context is None:
        _context = _make_context()
    if _context.pid != os.getpid():
        raise GalocError(
            "a process forked after the gl renderer was first used",
            "a process that starts its own renderer",
            'Start workers before rendering, or with the "spawn" method (AsyncVectorEnv(..., context="spawn")).',
        )
    if _context.thread != threading.get_ident():
        raise GalocError(
            "a call of the gl renderer from a second thread",
            "all rendering of a process in the thread that rendered first",
            "Use one thread, or one process for each renderer.",
        )
    return _context


def _make_context() -> Context:
    try:
        pyrender = _import_pyrender()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            offscreen = pyrender.OffscreenRenderer(64, 48)
            offscreen._renderer = _renderer_class(pyrender)(64, 48)
    except Exception as error:  # the library raises whatever its loaders meet: no common base class
        platform = os.environ.get("PYOPENGL_PLATFORM")
        raise GalocError(
            f"no OpenGL context with PYOPENGL_PLATFORM={platform} ({type(error).__name__}: {error})",
            "a machine with EGL",
            f"Install the software renderer (Debian: apt-get install {PACKAGES}) and leave PYOPENGL_PLATFORM unset.",
        ) from error
    return Context(pyrender, offscreen, os.getpid(), threading.get_ident(), [])

"""Check whether OpenGL can draw off screen here, and install the libraries for it where that is possible.

Only the renderer "gl" and its tests need it; "raster", the default, needs no system library. Runs alone, with the
standard library only: ``python3 scripts/system_check.py``.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys

PACKAGES = ("libegl1", "libgl1", "libgles2", "libegl-mesa0", "libgl1-mesa-dri")
"""Debian and Ubuntu packages that hold EGL, OpenGL and Mesa's software renderer."""

EGL_PLATFORM_DEVICE_EXT = 0x313F
MAX_DEVICES = 16


def _load(name: str) -> ctypes.CDLL | None:
    """Load a shared library for every later user of it, or None."""
    try:
        return ctypes.CDLL(name, mode=ctypes.RTLD_GLOBAL)
    except OSError:
        return None


def _first_device_opens(egl: ctypes.CDLL) -> bool:
    """Open the first EGL device, as the renderer will; a loader without any driver finds none."""
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    addresses = [egl.eglGetProcAddress(name) for name in (b"eglQueryDevicesEXT", b"eglGetPlatformDisplayEXT")]
    if None in addresses:
        return False
    query = ctypes.CFUNCTYPE(
        ctypes.c_uint, ctypes.c_int, ctypes.POINTER(ctypes.c_void_p), ctypes.POINTER(ctypes.c_int)
    )(addresses[0])
    get_display = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)(addresses[1])
    devices, count = (ctypes.c_void_p * MAX_DEVICES)(), ctypes.c_int()
    if not query(MAX_DEVICES, devices, ctypes.byref(count)) or count.value < 1:
        return False
    display = get_display(EGL_PLATFORM_DEVICE_EXT, devices[0], None)
    egl.eglInitialize.restype = ctypes.c_uint
    egl.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    return bool(display) and bool(egl.eglInitialize(display, None, None))


def missing() -> str:
    """What keeps this process from drawing off screen, in words; empty when nothing does."""
    egl = _load("libEGL.so.1")
    if egl is None:
        return "the library libEGL.so.1"
    if _load("libGL.so.1") is None:
        return "the library libGL.so.1"
    return "" if _first_device_opens(egl) else "a driver behind libEGL.so.1"


def missing_in_child() -> str:
    """:func:`missing`, asked in a fresh process: drivers keep state, and a broken one may crash its process."""
    result = subprocess.run([sys.executable, __file__, "--probe"], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        return "an EGL driver that starts without crashing"
    return result.stdout.strip()


def install() -> None:
    """Install :data:`PACKAGES` with apt-get; silent, and judged only by looking again afterwards."""
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for command in (
        ["update"],
        ["-o", "DPkg::Lock::Timeout=120", "install", "-y", "--no-install-recommends", *PACKAGES],
    ):
        subprocess.run(
            ["apt-get", "-qq", *command],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
        )


def main() -> int:
    """Check, install if need be and allowed, and say in one line what is left to do; nothing of it is an error."""
    if not sys.platform.startswith("linux"):
        print('galoc system check: renderer "gl" draws without a screen on Linux only', file=sys.stderr)
        return 0
    lack = missing_in_child()
    if lack and os.geteuid() == 0 and shutil.which("apt-get"):
        print(f"galoc system check: installing {' '.join(PACKAGES)} (missing: {lack})", flush=True)
        install()
        lack = missing_in_child()
    if lack:
        print(
            f'galoc system check: {lack} is missing: renderer "gl" cannot be used and its tests are skipped '
            f"(the default renderer needs nothing). To have it: sudo apt-get install {' '.join(PACKAGES)}",
            file=sys.stderr,
        )
    return 0


if __name__ == "__main__":
    if sys.argv[1:] == ["--probe"]:
        print(missing())
    else:
        sys.exit(main())

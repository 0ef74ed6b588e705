"""MuJoCo compiles an MJCF in a process that ends at a limit of memory and of processor time.

A few bytes can ask for any number of elements, or of pixels. This file is also what runs there. It
imports no more than that takes, so that the process starts in some 20 ms.
"""

from __future__ import annotations

import ctypes
import os
import resource
import sys
import threading
import time

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pathlib import Path

    import mujoco

MOST_BYTES, MOST_SECONDS = 2 * 10**9, 30.0  # of the processor
REFUSED = 3  # exit code: none of Python's own
ERROR_BYTES = 1000


def compile_guarded(path: Path) -> tuple[mujoco.MjModel, list[str]]:
    """Model of a file as MuJoCo compiles it, and what it warns of; a RobotFileError otherwise."""
    import subprocess
    import tempfile
    from pathlib import Path

    import mujoco

    from loopid.errors import RobotFileError

    # Any of its modules finds the library, wherever it is installed.
    libraries = [mujoco._functions.__file__, *map(str, Path(mujoco.PLUGINS_DIR).glob("*.*"))]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "model.mjb"
        limits = str(os.getpid()), str(MOST_BYTES), str(MOST_SECONDS)
        command = [sys.executable, "-I", "-S", __file__, path, place, *limits, *libraries]
        done = subprocess.run(
            command, check=False, capture_output=True, text=True, errors="backslashreplace"
        )
        if done.returncode == 0:
            return mujoco.MjModel.from_binary_path(str(place)), done.stdout.splitlines()
    if done.returncode == REFUSED:
        raise RobotFileError(f"MuJoCo refuses it: {done.stdout.splitlines()[-1]}")
    raise RobotFileError(f"MuJoCo crashes on it: exit code {done.returncode}")


def _compile(path: str, place: str, libraries: list[str]) -> None:
    """Write the model of a file to a place, and print what MuJoCo says."""
    library, *_ = map(ctypes.CDLL, libraries)
    heard = ctypes.CFUNCTYPE(None, ctypes.c_char_p)
    handlers = {"mju_user_warning": heard(_say), "mju_user_error": heard(_refuse)}
    for name, handler in handlers.items():
        ctypes.c_void_p.in_dll(library, name).value = ctypes.cast(handler, ctypes.c_void_p).value
    library.mj_loadXML.restype = ctypes.c_void_p
    error = ctypes.create_string_buffer(ERROR_BYTES)
    model = library.mj_loadXML(os.fsencode(path), None, error, ERROR_BYTES)
    if model is None:
        _refuse(error.value)
    library.mj_saveModel(ctypes.c_void_p(model), os.fsencode(place), None, 0)


def _say(text: bytes) -> None:
    os.write(1, b" ".join(text.split()) + b"\n")


def _refuse(text: bytes) -> None:
    _say(text)
    os._exit(REFUSED)


def _watch(parent: int, most_bytes: int, most_seconds: float) -> None:
    """End this process at its limits, or after its parent."""
    # On Linux ``ru_maxrss`` begins with what the parent had taken.
    statm = None if sys.platform == "darwin" else os.open("/proc/self/statm", os.O_RDONLY)

    def size() -> int:
        if statm is None:
            return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return resource.getpagesize() * int(os.pread(statm, ERROR_BYTES, 0).split()[1])

    while os.getppid() == parent:
        if size() > most_bytes:
            _refuse(b"it takes more than %g GB of memory" % (most_bytes / 1e9))
        if time.process_time() > most_seconds:
            _refuse(b"it takes more than %g s of the processor" % most_seconds)
        time.sleep(0.01)
    os._exit(REFUSED)


if __name__ == "__main__":
    path, place, parent, most_bytes, most_seconds, *libraries = sys.argv[1:]
    limits = int(parent), int(most_bytes), float(most_seconds)
    threading.Thread(target=_watch, args=limits, daemon=True).start()
    _compile(path, place, libraries)
    os._exit(0)

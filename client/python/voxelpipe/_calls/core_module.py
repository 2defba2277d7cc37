"""The package voxelpipe_core, where it is installed: the core in this process."""
from __future__ import annotations

import os
from typing import Any

from .._proto.google.rpc import status_pb2
from ..errors import MissingPackage, VoxelpipeError
from .status import of_status

core: Any = None  # the module; available() sets it
_looked = False
_used = False
_forked_after_use = False


def _after_fork() -> None:
    global _forked_after_use
    _forked_after_use = _used  # its threads and its device stayed in the parent


os.register_at_fork(after_in_child=_after_fork)


def available() -> bool:
    """True if voxelpipe_core is installed, and was not used before this process was forked.

    Errors: ImportError if it is installed and cannot be loaded.
    """
    global core, _looked
    if _forked_after_use:
        return False
    if not _looked:
        try:
            import voxelpipe_core
        except ModuleNotFoundError as error:
            if error.name != "voxelpipe_core":
                raise
        else:
            core = voxelpipe_core
        _looked = True
    return core is not None


def is_lost() -> bool:
    """True in a child process of one that has used voxelpipe_core, where it cannot be used."""
    return _forked_after_use


def running() -> Any:
    """The module, for work on threads of its own, if available(): a child process forked later cannot use it."""
    global _used
    _used = True
    return core


def needed(what: str) -> Any:
    """The module. In: what needs it, for the message. Errors: MissingPackage unless it is available."""
    if available():
        return core
    why = (
        "was used before this process was forked; start processes with 'spawn' or 'forkserver'"
        if _forked_after_use
        else "is not installed; client/python/README.md says how (Install)"
    )
    raise MissingPackage(f"{what} needs the package voxelpipe-core, which {why}", package="voxelpipe_core")


def error_of(failed: Any) -> VoxelpipeError:
    """The error of a voxelpipe_core.Failed."""
    return error_of_status(failed.args[0])


def error_of_status(status: bytes) -> VoxelpipeError:
    """The error of a google.rpc.Status."""
    return of_status(status_pb2.Status.FromString(status), "this process", "")

"""Runs requests in this process, by the package voxelpipe_core where it is installed."""
from __future__ import annotations

import os
from typing import Any

from .._proto.google.rpc import status_pb2
from ..device import DeviceGrid
from ..grid import VoxelGrid
from .reader import ResultReader
from .session import Job, Progress, Reporter
from .status import of_status

_DEFAULT_TIMEOUT_S = 600.0
_core: Any = None
_looked = False
_forked_after_use = False


def _after_fork() -> None:
    global _forked_after_use
    _forked_after_use = _core is not None  # its threads and its device stayed in the parent


os.register_at_fork(after_in_child=_after_fork)


def available() -> bool:
    """True if voxelpipe_core is installed, and was not used before this process was forked.

    Errors: ImportError if it is installed and cannot be loaded.
    """
    global _core, _looked
    if _forked_after_use:
        return False
    if not _looked:
        try:
            import voxelpipe_core
        except ModuleNotFoundError as error:
            if error.name != "voxelpipe_core":
                raise
        else:
            _core = voxelpipe_core
        _looked = True
    return _core is not None


def run(job: Job, timeout: float | None, progress: Progress) -> VoxelGrid:
    """Runs a job with a mesh file. timeout: seconds; None: 600. Errors: those of voxelize()."""
    return _reader(job).taken_over(*_run(job, timeout, progress, False))


def run_on_device(job: Job, timeout: float | None, progress: Progress) -> DeviceGrid:
    """The same, whose arrays stay on the GPU. Errors: also NotAvailable if they cannot."""
    return _reader(job).taken_on_device(*_run(job, timeout, progress, True))


def _reader(job: Job) -> ResultReader:
    return ResultReader(job.request, max_result_bytes=1 << 63, request_id="", report=None)


def _run(job: Job, timeout: float | None, progress: Progress, on_device: bool) -> tuple[bytes, list[Any], bytes]:
    reporter = Reporter(progress)
    try:
        answer: tuple[bytes, list[Any], bytes] = _core.run(
            job.config().SerializeToString(),
            job.data,
            _DEFAULT_TIMEOUT_S if timeout is None else timeout,
            None if progress is None else lambda stage, fraction: reporter(stage, fraction, 0),
            on_device,
        )
    except _core.Failed as failed:
        raise of_status(status_pb2.Status.FromString(failed.args[0]), "this process", "") from None
    finally:
        reporter.close()
    return answer

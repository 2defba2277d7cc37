"""Runs requests in this process, by the package voxelpipe_core where it is installed."""
from __future__ import annotations

from typing import Any

from ..device import DeviceGrid
from ..grid import VoxelGrid
from . import core_module
from .progress import Progress, Reporter
from .reader import ResultReader
from .session import Job, named

_DEFAULT_TIMEOUT_S = 600.0


def run(job: Job, timeout: float | None, progress: Progress) -> VoxelGrid:
    """Runs a job with a mesh file, if core_module.available(). timeout: seconds; None: 600.

    Errors: those of voxelize().
    """
    return _reader(job).taken_over(*_run(job, timeout, progress, False))


def run_on_device(job: Job, timeout: float | None, progress: Progress) -> DeviceGrid:
    """The same, whose arrays stay on the GPU. Errors: also NotAvailable if they cannot."""
    return _reader(job).taken_on_device(*_run(job, timeout, progress, True))


def _reader(job: Job) -> ResultReader:
    return ResultReader(job.request, max_result_bytes=1 << 63, request_id="", report=None)


def _run(job: Job, timeout: float | None, progress: Progress, on_device: bool) -> tuple[bytes, list[Any], bytes]:
    core = core_module.core
    reporter = Reporter(progress)
    try:
        answer: tuple[bytes, list[Any], bytes] = core.run(
            job.config().SerializeToString(),
            job.data,
            _DEFAULT_TIMEOUT_S if timeout is None else timeout,
            None if progress is None else lambda stage, fraction: reporter(stage, fraction, 0),
            on_device,
        )
    except core.Failed as failed:
        raise named(core_module.error_of(failed), job.file) from None
    finally:
        reporter.close()
    return answer

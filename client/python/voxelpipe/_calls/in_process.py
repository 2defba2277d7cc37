"""Runs requests in this process, by the package voxelpipe_core where it is installed."""
from __future__ import annotations

import dataclasses
from typing import Any, Sequence, Union

from .._mesh.forms import MeshFile
from .._mesh.placed import Source
from .._proto.voxelpipe.v1 import mesh_pb2
from .._proto.voxelpipe.v1 import voxelization_service_pb2 as service
from ..device import DeviceGrid
from ..errors import MeshNotFound, VoxelpipeError
from ..grid import VoxelGrid
from ..report import MeshHealth, MeshInfo, MeshReport, read_warnings
from ..request import Request
from . import core_module
from .progress import Progress, Reporter
from .reader import ResultReader
from .retry import Deadline
from .session import Job, named

DEFAULT_TIMEOUT_S = 600.0
ANY_BYTES = 1 << 63
Held = Any  # voxelpipe_core.HeldMesh; of several meshes a list of them
_Answer = tuple[bytes, list[Any], bytes]


def run(
    job: Job, timeout: float | None, progress: Progress, held: Held = None, max_result_bytes: int = ANY_BYTES
) -> VoxelGrid:
    """Runs a job with a mesh file, of a held mesh perhaps with new positions, or of several held meshes, if
    core_module.available().

    timeout: seconds; None: 600. Errors: those of voxelize().
    """
    return _reader(job.request, max_result_bytes).taken_over(*_run(job, timeout, progress, False, held))


def run_on_device(job: Job, timeout: float | None, progress: Progress) -> DeviceGrid:
    """The same, whose arrays stay on the GPU; loads the files of several meshes. Errors: also NotAvailable if they
    cannot.
    """
    deadline, held = Deadline(_seconds(timeout)), None
    if job.placed is not None:
        held = load_several(job.placed.sources, deadline, progress)
    return _reader(job.request).taken_on_device(*_run(job, deadline.left(), progress, True, held))


def run_all(
    request: Request,
    meshes: Sequence[Union[MeshFile, Held]],
    timeout: float | None,
    max_result_bytes: int = ANY_BYTES,
) -> list[VoxelGrid | VoxelpipeError]:
    """The same request of many files or held meshes, in batches of the core. Out: a result or an error each."""
    listed = [
        (mesh.data, mesh.format, mesh.unit_code) if isinstance(mesh, MeshFile) else (mesh, 0, 0) for mesh in meshes
    ]
    answers = core_module.running().run_all(request.encoded, listed, _seconds(timeout))
    results: list[VoxelGrid | VoxelpipeError] = []
    for mesh, answer in zip(meshes, answers):
        if isinstance(answer, bytes):
            error = core_module.error_of_status(answer)
            results.append(named(error, mesh) if isinstance(mesh, MeshFile) else error)
        else:
            try:
                results.append(_reader(request, max_result_bytes).taken_over(*answer))
            except VoxelpipeError as error:
                results.append(error)
    return results


def load(file: MeshFile, name: str, timeout: float | None, progress: Progress) -> Held:
    """Loads a mesh that stays in memory. Errors: those of voxelize()."""
    core = core_module.running()
    reporter = Reporter(progress)
    try:
        return core.load(file.data, file.format, file.unit_code, name, _seconds(timeout), _told(progress, reporter))
    except core.Failed as failed:
        raise named(core_module.error_of(failed), file) from None
    finally:
        reporter.close()


def load_several(sources: Sequence[Source], deadline: Deadline, progress: Progress) -> list[Held]:
    """The meshes of several. Files are loaded side by side, and once as long as callers keep them.

    Errors: those of voxelize(), of the first one that fails; MeshNotFound for one without a file.
    """
    new: list[tuple[Source, MeshFile]] = []
    for source in sources:
        file = source.named_file
        if file is None:
            raise not_found(source.name)
        if source.loaded is None:
            new.append((source, file))
    if len(new) == 1:
        source, file = new[0]
        source.keep(load(file, source.name, deadline.left(), progress))
    elif new:
        _load_all(new, deadline.left(), progress)
    return [source.loaded for source in sources]


def _load_all(new: Sequence[tuple[Source, MeshFile]], timeout: float | None, progress: Progress) -> None:
    reporter = Reporter(progress)
    listed = [(file.data, file.format, file.unit_code, source.name) for source, file in new]
    try:
        reporter("load", 0.0, 0)
        answers = core_module.running().load_all(listed, _seconds(timeout))
        reporter("load", 1.0, 0)
    finally:
        reporter.close()
    failed = None
    for (source, file), answer in zip(new, answers):
        if not isinstance(answer, bytes):
            source.keep(answer)
        elif failed is None:
            failed = named(core_module.error_of_status(answer), file)
    if failed is not None:
        raise failed


def not_found(name: str) -> MeshNotFound:
    """The error for a mesh that is not loaded."""
    return MeshNotFound(f"the mesh {name} is not loaded in this process", name=name)


def estimate(job: Job, held: Held, timeout: float | None) -> service.EstimateVoxelizationResponse:
    """The plan of a job with a mesh file, of a held mesh or of several. Errors: those of voxelize()."""
    core = core_module.running()
    try:
        answer = core.estimate(_request(job), job.data if held is None else held, _seconds(timeout))
    except core.Failed as failed:
        raise named(core_module.error_of(failed), job.file) from None
    response: service.EstimateVoxelizationResponse = service.EstimateVoxelizationResponse.FromString(answer)
    return response


def mesh_info(held: Held, timeout: float | None) -> MeshInfo:
    """What a held mesh is like. Errors: those of voxelize()."""
    core = core_module.running()
    try:
        health = MeshHealth(**held.health(_seconds(timeout)))
    except core.Failed as failed:
        raise core_module.error_of(failed) from None
    described = mesh_pb2.Mesh.FromString(held.describe())
    report = dataclasses.replace(
        MeshReport.of(described.report),
        degenerate_triangles=health.degenerate_triangles,
        open_edges=health.open_edges,
    )
    return MeshInfo(report, read_warnings(described), health)


def _request(job: Job) -> bytes:
    """The VoxelizeRequest without the bytes of its mesh."""
    return b"".join(job.message(False))


def _seconds(timeout: float | None) -> float:
    return DEFAULT_TIMEOUT_S if timeout is None else timeout


def _told(progress: Progress, reporter: Reporter) -> Any:
    return None if progress is None else lambda stage, fraction: reporter(stage, fraction, 0)


def _reader(request: Request, max_result_bytes: int = ANY_BYTES) -> ResultReader:
    return ResultReader(request, max_result_bytes, request_id="", report=None)


def _run(job: Job, timeout: float | None, progress: Progress, on_device: bool, held: Held) -> _Answer:
    core = core_module.running()
    reporter = Reporter(progress)
    positions = None if held is None or job.file is None else job.file.data
    mesh = job.data if held is None else held
    try:
        answer: _Answer = core.run(
            _request(job), mesh, _seconds(timeout), _told(progress, reporter), on_device, positions
        )
    except core.Failed as failed:
        raise named(core_module.error_of(failed), job.file) from None
    finally:
        reporter.close()
    return answer

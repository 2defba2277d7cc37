"""Files of results, in the forms that the command line writes."""
from __future__ import annotations

import json
import os
import pathlib
from typing import TYPE_CHECKING, Any

import numpy

if TYPE_CHECKING:
    from ..grid import VoxelGrid

_EXTENSIONS = (".npy", ".npz", ".raw", ".png")


def save(grid: "VoxelGrid", path: "str | os.PathLike[str]") -> None:
    """See VoxelGrid.save. The file appears under its name when it is complete. Errors: ValueError, OSError."""
    target = pathlib.Path(path)
    kind = target.suffix.lower()
    if kind not in _EXTENSIONS:
        raise ValueError(f"{target}: the extension is none of {', '.join(_EXTENSIONS)}")
    if kind in (".npy", ".raw") and (grid.kind != "dense" or len(grid.targets) != 1):
        raise ValueError(f"{target}: {kind} holds one target of a dense result; .npz holds all")
    if kind == ".raw":
        description = json.dumps(_description(grid), indent=2) + "\n"
        _write(pathlib.Path(f"{target}.json"), lambda file: file.write(description.encode()))
    _write(target, lambda file: _fill(grid, kind, file))


def _write(path: pathlib.Path, fill: Any) -> None:
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with open(part, "wb") as file:
            fill(file)
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def _fill(grid: "VoxelGrid", kind: str, file: Any) -> None:
    if kind == ".npy":
        numpy.save(file, _as_written(grid.array))
    elif kind == ".npz":
        numpy.savez(file, **_arrays(grid))
    elif kind == ".raw":
        name = grid.targets[0].name
        file.write(grid.packed(name) if grid.targets[0].format == "bit" else grid.stored[name].reshape(-1).data)
    else:
        file.write(grid._repr_png_())


def _as_written(array: Any) -> Any:
    return array.view(numpy.uint8) if array.dtype == numpy.bool_ else array


def _arrays(grid: "VoxelGrid") -> dict[str, Any]:
    arrays: dict[str, Any] = {}
    if grid.kind == "sparse":
        arrays["ijk"] = grid.occupied()
    elif grid.kind == "buckets":
        buckets = grid.buckets
        arrays |= {"ijk": buckets.ijk, "offsets": buckets.offset.astype(numpy.int64), "triangle": buckets.triangle}
    arrays |= {target.name: _as_written(grid[target.name]) for target in grid.targets}
    return arrays | {
        "dims": numpy.asarray(grid.dims, numpy.int64),
        "origin": numpy.asarray(grid.origin_corner),
        "voxel_size": numpy.asarray(grid.voxel_size),
        "index_to_world": grid.index_to_world,
    }


def _description(grid: "VoxelGrid") -> dict[str, Any]:
    target = grid.targets[0]
    shape = grid.stored[target.name].shape
    components = shape[0 if grid.layout == "planar" else -1] if len(shape) == 4 else 1
    return {
        "dims": list(grid.dims),
        "origin": list(grid.origin_corner),
        "voxel_size": list(grid.voxel_size),
        "index_to_world": grid.index_to_world.ravel().tolist(),
        "targets": [{"format": target.format, "components": components}],
        "layout": grid.layout,
        "order": "x fastest: n = i + nx*(j + ny*k)",
        "hash": grid.sha256,
    }

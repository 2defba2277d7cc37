"""Pictures of results for notebooks: three views of the occupied voxels, lit by their depth."""
from __future__ import annotations

import base64
import html as html_text
import os
import struct
import sys
import tempfile
import webbrowser
import zlib
from typing import TYPE_CHECKING, Any

import numpy
import numpy.typing

from . import save

if TYPE_CHECKING:
    from ..grid import VoxelGrid

Array = numpy.typing.NDArray[Any]

_VIEW_PIXELS = 320  # of the longest side
_GAP_PIXELS = 8
_NAMES = 12  # of parts, in a table
_BACKGROUND = (34, 37, 43)
_PLAIN = (205, 214, 228)
_PAGE = (
    '<!DOCTYPE html><meta charset="utf-8"><title>voxels</title>'
    "<style>body{{font-family:sans-serif}} th{{text-align:left;padding-right:1em}}</style>{}"
)
_MAX_AXIS = 320  # larger grids are thinned, several voxels to one


def write_png(pixels: Array) -> bytes:
    """A PNG of RGB pixels, uint8 (height, width, 3). Source: the PNG specification, sections 5 and 11."""
    height, width, _ = pixels.shape
    rows = numpy.concatenate([numpy.zeros((height, 1), numpy.uint8), pixels.reshape(height, -1)], axis=1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    image = zlib.compress(rows.tobytes(), 6)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", image) + chunk(b"IEND", b"")


def png(grid: "VoxelGrid") -> bytes:
    """Views along -z, -y and -x, side by side."""
    occupied, colors = _small(grid)
    views = [_view(occupied, colors, axis, grid.voxel_size) for axis in (2, 1, 0)]
    height = max(view.shape[0] for view in views)
    width = sum(view.shape[1] for view in views) + _GAP_PIXELS * (len(views) + 1)
    sheet = numpy.empty((height + 2 * _GAP_PIXELS, width, 3), numpy.uint8)
    sheet[:] = _BACKGROUND
    left = _GAP_PIXELS
    for view in views:
        top = _GAP_PIXELS + (height - view.shape[0]) // 2
        sheet[top : top + view.shape[0], left : left + view.shape[1]] = view
        left += view.shape[1] + _GAP_PIXELS
    return write_png(sheet)


def _small(grid: "VoxelGrid") -> tuple[Array, Array | None]:
    """The occupied voxels (x, y, z), thinned to a size for pictures, and the colour of each, if there is one."""
    step = max(1, -(-max(grid.dims) // _MAX_AXIS))
    if grid.kind == "dense":
        try:
            ijk = grid.occupied()
        except ValueError:  # no bits: voxels whose values are not all zero
            array = grid.dense()
            lit = array if array.ndim == 3 else array.any(axis=-1)
            ijk = grid.place.linear_to_ijk(numpy.flatnonzero(lit))
    else:
        ijk = grid.occupied()
    small = ijk // step
    shape = tuple(-(-axis // step) for axis in grid.dims)
    occupied = numpy.zeros(shape, numpy.bool_)
    occupied[small[:, 0], small[:, 1], small[:, 2]] = True
    listed = _colors(grid, ijk)
    if listed is None:
        return occupied, None
    colors = numpy.zeros((*shape, 3), numpy.uint8)
    colors[small[:, 0], small[:, 1], small[:, 2]] = listed
    return occupied, colors


def _colors(grid: "VoxelGrid", ijk: Array) -> Array | None:
    if grid.kind == "buckets":
        return None
    for target in grid.targets:
        if target.format != "u8" or target.shader is None or target.shader.name not in ("base_color", "color"):
            continue
        array = grid.dense(target.name) if grid.kind == "dense" else grid.sparse().values[target.name]
        if array.shape[-1] not in (3, 4) or array.ndim != (4 if grid.kind == "dense" else 2):
            continue
        values: Array = array[ijk[:, 2], ijk[:, 1], ijk[:, 0], :3] if grid.kind == "dense" else array[:, :3]
        return values
    return None


def _view(occupied: Array, colors: Array | None, axis: int, voxel_size: tuple[float, float, float]) -> Array:
    """What a viewer on the positive side of an axis sees: y (or, along y, -z) is up."""
    right, up = ((1, 2), (0, 2), (0, 1))[axis]
    if axis == 0:
        right, up = 2, 1
    order = (axis, up, right)
    solid = occupied.transpose(order)[::-1]  # first along the view
    hit = solid.any(axis=0)
    depth = solid.argmax(axis=0)
    if colors is None:
        shade = numpy.empty((*hit.shape, 3))
        shade[:] = _PLAIN
    else:
        listed = colors.transpose(*order, 3)[::-1]
        rows, columns = numpy.indices(hit.shape)
        shade = listed[depth, rows, columns].astype(numpy.float64)
    shade *= _light(depth, hit)[..., None]
    pixels = numpy.where(hit[..., None], numpy.clip(shade, 0, 255), numpy.asarray(_BACKGROUND, numpy.float64))
    if axis != 1:
        pixels = pixels[::-1]  # rows of a picture go down
    if axis == 0:
        pixels = pixels[:, ::-1]
    return _scaled(pixels.astype(numpy.uint8), voxel_size[up], voxel_size[right])


def _light(depth: Array, hit: Array) -> Array:
    """Brightness by the slope of the surface, and by its depth."""
    surface = numpy.where(hit, depth, depth.max(initial=0)).astype(numpy.float64)
    down = numpy.gradient(surface, axis=0) if surface.shape[0] > 1 else numpy.zeros_like(surface)
    across = numpy.gradient(surface, axis=1) if surface.shape[1] > 1 else numpy.zeros_like(surface)
    normal = numpy.stack([across, down, numpy.ones_like(surface)], axis=-1)
    normal /= numpy.linalg.norm(normal, axis=-1, keepdims=True)
    lit = normal @ (numpy.asarray([-0.35, 0.5, 0.8]) / numpy.linalg.norm([0.35, 0.5, 0.8]))
    far = surface / max(1, int(depth.max(initial=1)))
    brightness: Array = (0.35 + 0.65 * numpy.clip(lit, 0, 1)) * (1.0 - 0.35 * far)
    return brightness


def _scaled(pixels: Array, row_size: float, column_size: float) -> Array:
    """Nearest neighbours, so that voxels have their shape."""
    height, width = pixels.shape[0] * row_size, pixels.shape[1] * column_size
    scale = _VIEW_PIXELS / max(height, width)
    rows = max(1, round(height * scale))
    columns = max(1, round(width * scale))
    tall = pixels[numpy.arange(rows) * pixels.shape[0] // rows]
    scaled: Array = tall[:, numpy.arange(columns) * pixels.shape[1] // columns]
    return scaled


def _listed(names: list[str]) -> str:
    shown = ", ".join(name or "(no name)" for name in names[:_NAMES])
    return shown if len(names) <= _NAMES else f"{shown} and {len(names) - _NAMES} more"


def html(grid: "VoxelGrid") -> str:
    """A table of size and place, and the picture."""
    low, high = grid.bounds
    rows = {
        "result": f"{grid.kind}, " + " x ".join(map(str, grid.dims)) + " voxels",
        "voxel size": " x ".join(f"{size:.6g}" for size in grid.voxel_size),
        "from corner": ", ".join(f"{value:.6g}" for value in low),
        "to corner": ", ".join(f"{value:.6g}" for value in high),
        "occupied": f"{grid.summary.occupied:,}",
        "targets": ", ".join(f"{target.name} ({target.format})" for target in grid.targets),
        **({} if grid.parts is None else {"parts": _listed(grid.parts.name)}),
        "computed by": f"{grid.summary.backend}, {grid.summary.voxelize_ms:.1f} ms",
    }
    if grid.warnings:
        rows["warnings"] = "; ".join(map(str, grid.warnings))
    cells = "".join(f"<tr><th>{key}</th><td>{html_text.escape(value)}</td></tr>" for key, value in rows.items())
    picture = base64.b64encode(png(grid)).decode()
    return f'<table>{cells}</table><img alt="views along z, y and x" src="data:image/png;base64,{picture}">'


def show(grid: "VoxelGrid") -> None:
    """See VoxelGrid.show."""
    if "IPython" in sys.modules:
        from IPython import display, get_ipython

        if get_ipython() is not None:
            display.display(display.HTML(html(grid)))
            return
    viewer = save.has_viewer(grid)
    with tempfile.NamedTemporaryFile("w", encoding="utf-8", prefix="voxelpipe-", suffix=".html", delete=False) as file:
        if not viewer:
            file.write(_PAGE.format(html(grid)))
    if viewer:
        try:
            save.save(grid, file.name)
        except BaseException:
            os.unlink(file.name)
            raise
    webbrowser.open(f"file://{file.name}")

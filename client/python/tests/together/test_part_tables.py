"""The table of parts of a result: VoxelGrid.parts."""
from __future__ import annotations

import asyncio
import contextlib
import json
import pathlib
import pickle
import subprocess
from typing import Any

import numpy
import pytest

import voxelpipe
from voxelpipe import AsyncClient, Client, InProcessClient, LocalServer, Part, Parts, VoxelGrid
from voxelpipe._calls import core_module
from voxelpipe._calls.part_arrays import read_parts
from voxelpipe._calls.reader import ResultReader
from voxelpipe._calls.session import Job
from voxelpipe.options import make_request

from .. import shapes
from ..recipes.scenes import Body, ball, box, rod, write_scene
from ..test_save import FORMATS, contents

# An open box stands third; the last two have the same name.
OPEN = shapes.cube()[0] + (8, 0, 0), shapes.cube()[1][1:]
BODIES = [
    Body("block", "clay", box((0, 0, 0), (4, 4, 4))),
    Body("core", "metal", ball((2, 2, 2), 1)),
    Body("lid", "clay", OPEN),
    Body("rad ü", "metal", rod((5, 1, 1), (6, 3, 2), 0.5)),
    Body("rad ü", "metal", rod((5, 1, 3), (6, 3, 3.5), 0.5)),
]
NAMES = ["block", "core", "lid", "rad ü", "rad ü"]
GLB = write_scene(BODIES)
OPTIONS: dict[str, Any] = {"resolution": 40, "parts": "node", "coverage": "none", "label": "label:u8"}
FILLED: dict[str, Any] = {**OPTIONS, "fill": "nonzero"}


@pytest.fixture()
def glb(tmp_path: pathlib.Path) -> pathlib.Path:
    (tmp_path / "scene.glb").write_bytes(GLB)
    return tmp_path / "scene.glb"


def parts_of(grid: Any) -> Parts:
    assert isinstance(grid, VoxelGrid) and grid.parts is not None
    return grid.parts


def test_the_columns(client: Client) -> None:
    grid = client.voxelize(GLB, part_label={"core": 9}, part_priority={"rad*": -2}, **FILLED)
    parts = parts_of(grid)
    assert len(parts) == 5 and parts.name == NAMES
    assert parts.label.dtype == numpy.uint32 and parts.label.tolist() == [1, 9, 3, 4, 5]
    assert parts.priority.dtype == numpy.int32 and parts.priority.tolist() == [0, 0, 0, -2, -2]
    assert parts.triangles.dtype == numpy.int64 and parts.triangles.tolist() == [len(body.corners) for body in BODIES]
    assert parts.open_edges is not None and parts.odd_columns is not None and parts.voxels is not None
    assert parts.open_edges.dtype == parts.odd_columns.dtype == parts.voxels.dtype == numpy.int64
    assert parts.open_edges.tolist() == [0, 0, 4, 0, 0]
    # The lid is open below: rows along x still enter and leave it.
    assert parts.odd_columns.tolist() == [0] * 5 and grid.summary.odd_columns == 0
    assert [warning.code for warning in grid.warnings] == ["part_open"]
    assert parts.voxels.sum() == grid.summary.occupied == numpy.count_nonzero(grid.label)
    for part in parts:
        assert part.voxels == numpy.count_nonzero(grid.label == part.label) > 0
    cells = 64 / float(numpy.prod(grid.voxel_size))
    assert parts.voxels[0] + parts.voxels[1] == pytest.approx(cells, rel=0.1), "the core is in the block"


def test_a_part_that_is_open_along_x_has_odd_columns(client: Client) -> None:
    vertices, quads = shapes.cube()
    lid = Body("lid", "clay", (vertices, quads[:5]))  # without its side at x = 1
    options: dict[str, Any] = {**FILLED, "resolution": 8}
    parts = parts_of(client.voxelize(write_scene([BODIES[0], lid]), **options))
    assert parts.open_edges is not None and parts.open_edges.tolist() == [0, 4]
    assert parts.odd_columns is not None and parts.odd_columns[0] == 0 < parts.odd_columns[1] <= 4


def test_without_a_fill_there_are_no_counts(client: Client) -> None:
    for options in ({"result": "dense"}, {"result": "sparse"}, {"result": "buckets"}):
        asked: dict[str, Any] = {"parts": "material", "targets": "label:u8:max", **options}
        grid = client.voxelize(GLB, resolution=20, **asked)
        parts = parts_of(grid)
        assert parts.name == ["clay", "metal"] and parts.triangles.tolist() == [12 + 10, 2208 + 2 * 192]
        assert parts.open_edges is parts.odd_columns is parts.voxels is None
        assert parts[0] == Part(0, "clay", 1, 0, 22, None, None, None)


def test_other_requests_have_none(client: Client) -> None:
    assert client.voxelize(GLB, resolution=8).parts is None
    assert client.voxelize(GLB, resolution=8, fill="parity", parts="whole").parts is None
    assert client.voxelize(GLB, resolution=8, fill="parity", parts="node", exclude="*").parts is None
    assert "parts" not in repr(client.voxelize(GLB, resolution=8))


def test_every_call_gives_the_same(client: Client) -> None:
    kinds: list[Any] = ["dense", "sparse"]
    for kind in kinds:
        grid = client.voxelize(GLB, result=kind, content_hash=True, **FILLED)
        assert grid.parts is not None and grid == client.voxelize(client.upload(GLB), result=kind, **FILLED)
        assert list(client.voxelize_many([GLB, GLB], result=kind, **FILLED)) == [grid, grid]
        assert grid.nbytes - sum(a.nbytes for a in (*grid.stored.values(), *grid.lists.values())) == grid.parts.nbytes


def test_in_process_as_served(server: LocalServer) -> None:
    if not core_module.available():
        pytest.skip("voxelpipe_core is not installed")

    async def asynchronous() -> VoxelGrid:
        async with AsyncClient(server.server) as opened:
            return await opened.voxelize(GLB, **FILLED)

    with server.client() as served, InProcessClient() as inside:
        grid = inside.voxelize(GLB, **FILLED)
        assert parts_of(grid) == parts_of(served.voxelize(GLB, **FILLED)) == parts_of(asyncio.run(asynchronous()))
        assert grid == served.voxelize(GLB, compression="none", **FILLED)


def test_a_table_may_be_larger_than_the_voxels(client: Client) -> None:
    vertices, faces = shapes.TETRAHEDRON
    bodies = [Body(f"{i} {'n' * 2000}", "m", (vertices + (i, 0, 0), faces)) for i in range(2500)]
    handle = client.upload(write_scene(bodies))
    grid = client.voxelize(handle, resolution=8, parts="node", fill="parity")
    assert parts_of(grid).name == [body.name for body in bodies] and grid.nbytes > 5_000_000
    (again,) = client.voxelize_many([handle], resolution=8, parts="node", fill="parity")
    assert again == grid


def test_placed_meshes_are_parts(client: Client) -> None:
    there = numpy.eye(4)
    there[0, 3] = 2
    options: dict[str, Any] = {**FILLED, "parts": "file"}
    grid = client.voxelize(
        [shapes.TETRAHEDRON, shapes.cube()],  # without names of their own
        together=True,
        transforms=[None, there],
        names=["a*b", "a*b"],
        labels=[7, 70],
        priorities=[None, 3],
        **options,
    )
    parts = parts_of(grid)
    assert [(part.label, part.priority, part.triangles) for part in parts] == [(7, 0, 4), (70, 3, 12)]
    assert parts.name == ["a*b", "a*b"]


def test_grid_options_move_the_voxels_alone(client: Client) -> None:
    whole = parts_of(client.voxelize(GLB, **FILLED))
    turned = parts_of(client.voxelize(GLB, axes="z,x,y", **FILLED))
    assert turned.voxels is not None and whole.voxels is not None
    assert turned.voxels.tolist() == whole.voxels.tolist() and turned.label.tolist() == whole.label.tolist()
    block = client.voxelize(GLB, clip=(0, 0, 0, 4, 4, 4), **FILLED)
    clipped = parts_of(block)
    assert clipped.name == NAMES and clipped.triangles.tolist() == whole.triangles.tolist()
    assert clipped.voxels is not None and clipped.voxels[2:].tolist() == [0, 0, 0]  # outside of the grid
    assert clipped.voxels.sum() == block.place.voxels == 40**3


def table() -> Parts:
    """Of a result that was made by hand."""
    texts = [name.encode() for name in NAMES]
    columns = {
        "label": numpy.array([1, 9, 3, 4, 5], "<u4"),
        "priority": numpy.array([0, 0, 0, -2, -2], "<i4"),
        "triangles": numpy.array([12, 2208, 10, 192, 192], "<u8"),
        "open_edges": numpy.array([0, 0, 4, 0, 0], "<u8"),
        "odd_columns": numpy.zeros(5, "<u8"),
        "voxels": numpy.array([100, 20, 3, 5, 1 << 40], "<u8"),
        "name_offset": numpy.cumsum([0, *map(len, texts)]).astype("<u8"),
        "name": numpy.frombuffer(b"".join(texts), "u1"),
    }
    made = read_parts({f"part_{name}": array for name, array in columns.items()})
    assert made is not None
    return made


def test_parts_are_found() -> None:
    parts = table()
    core = Part(1, "core", 9, 0, 2208, 0, 0, 20)
    assert parts["core"] == parts[1] == parts[-4] == parts[numpy.int64(1)] == core
    assert parts[1:3] == [core, parts["lid"]] and list(parts)[::-1] == list(reversed(parts))
    assert "core" in parts and "door" not in parts and core in parts and 7 not in parts
    assert [part.number for part in parts.named("rad ü")] == [3, 4] == [part.number for part in parts.named("r*")]
    assert [part.name for part in parts.named("?o?e")] == ["core"]
    assert parts.named("COR*") == parts.named("[c]ore") == []
    with pytest.raises(KeyError, match="2 parts are called 'rad ü'; see named"):
        parts["rad ü"]
    with pytest.raises(KeyError, match="'door'; there are 'block', 'core', 'lid', 'rad ü'"):
        parts["door"]
    for number in (5, -6):
        with pytest.raises(IndexError, match=f"there is no part {number}; there are 5"):
            parts[number]
    with pytest.raises(TypeError):
        parts[1.0]  # type: ignore[call-overload]


def test_parts_are_values() -> None:
    parts, same = table(), table()
    assert parts == same == pickle.loads(pickle.dumps(parts)) and parts != list(parts)
    for array in same._arrays.values():
        one = pickle.loads(pickle.dumps(parts))
        changed = next(mine for mine, other in zip(one._arrays.values(), same._arrays.values()) if other is array)
        changed.flags.writeable = True
        changed[0] += 1
        assert one != parts
    with pytest.raises(TypeError):
        hash(parts)


def test_parts_are_printed(server: LocalServer) -> None:
    assert repr(table()) == (
        "<Parts: 5\n"
        "           label  priority  triangles  open edges         voxels\n"
        "  'block'      1         0         12           0            100\n"
        "  'core'       9         0       2208           0             20\n"
        "  'lid'        3         0         10           4              3\n"
        "  'rad ü'      4        -2        192           0              5\n"
        "  'rad ü'      5        -2        192           0  1099511627776>"
    )
    bodies = [Body(f"body {i}", "m", box((i, 0, 0), (i + 1, 1, 1))) for i in range(20)]
    grid = voxelpipe.voxelize(write_scene(bodies), resolution=20, parts="node")
    assert repr(grid).endswith("; parts: 20>") and repr(grid.parts).endswith("\n  and 8 more>")
    assert "<th>parts</th><td>body 0, body 1, " in grid._repr_html_() and "body 11 and 8 more<" in grid._repr_html_()


def test_a_grid_with_another_table_is_another(client: Client) -> None:
    grid = client.voxelize(GLB, resolution=9, parts="node", mask="occupancy:bit")
    other = client.voxelize(GLB, resolution=9, parts="node", part_label={"lid": 8}, mask="occupancy:bit")
    assert numpy.array_equal(grid.mask, other.mask) and grid != other and grid.sha256 != other.sha256
    assert pickle.loads(pickle.dumps(grid)) == grid != client.voxelize(GLB, resolution=9, mask="occupancy:bit")


class _Buffer:
    """A stand-in for voxelpipe_core.DeviceBuffer."""

    def __init__(self, size: int) -> None:
        self.size = size


def test_results_on_a_device_have_the_table_here() -> None:
    if not core_module.available():
        pytest.skip("voxelpipe_core is not installed")
    options: dict[str, Any] = {**FILLED, "resolution": 12}
    request = make_request(**options)
    file = voxelpipe.load_mesh(GLB)
    header, arrays, summary = core_module.running().run(
        b"".join(Job(request, file).message(False)), file.data, 60.0, None
    )
    here = ResultReader(request, 1 << 40, "", None).taken_over(header, arrays, summary)
    buffers = [*(_Buffer(array.size) for array in arrays[:2]), *arrays[2:]]
    there = ResultReader(request, 1 << 40, "", None).taken_on_device(header, buffers, summary)
    assert [*there.arrays] == ["mask", "label"] and there.parts is not None and there.parts == here.parts
    with pytest.raises(voxelpipe.DataLoss, match="arrays of other sizes"):
        ResultReader(request, 1 << 40, "", None).taken_on_device(header, buffers[:-1], summary)


def told_by(cli: str, glb: pathlib.Path, *options: object) -> Any:
    parts = ["--parts", "node", "--part-label", "core=9", "--resolution", 40]
    command = [cli, "voxelize", glb, *parts, *options, "--json"]
    return json.loads(subprocess.run([*map(str, command)], check=True, capture_output=True, text=True).stdout)


@pytest.mark.parametrize("kind", ["dense", "sparse", "buckets"])
def test_the_table_is_that_of_the_command_line(client: Client, cli: str, glb: pathlib.Path, kind: Any) -> None:
    fill = "none" if kind == "buckets" else "parity"
    options: dict[str, Any] = {"targets": "label:u16:max", "part_label": "core=9", "fill": fill, "result": kind}
    grid = client.voxelize(GLB, resolution=40, parts="node", **options)
    written = glb.with_name("a.npz")
    told = told_by(cli, glb, "--target", "label:u16:max", "--fill", fill, "--result", kind, "-o", written)
    assert told["hash"] == grid.sha256
    parts = parts_of(grid)
    assert told["parts"]["name"] == parts.name == NAMES
    counted = () if kind == "buckets" else ("open_edges", "odd_columns", "voxels")
    for column in ("label", "priority", "triangles", *counted):
        assert told["parts"][column] == getattr(parts, column).tolist(), column
    assert parts_of(voxelpipe.load_result(written)) == parts
    ours = glb.with_name("b.npz")
    grid.save(ours)
    with numpy.load(written) as one, numpy.load(ours) as other:
        assert sorted(one.files) == sorted(other.files)
        assert all(one[name].dtype == other[name].dtype for name in one.files)
        assert all(numpy.array_equal(one[name], other[name]) for name in one.files)


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("kind", ["dense", "sparse", "buckets"])
def test_a_file_gives_the_table_back(client: Client, tmp_path: pathlib.Path, kind: Any, compress: bool) -> None:
    options: dict[str, Any] = {} if kind == "buckets" else {"fill": "nonzero"}
    grid = client.voxelize(GLB, resolution=20, parts="node", result=kind, label="label:u16:max", **options)
    grid.save(tmp_path / "a.npz", compress=compress)
    loaded = voxelpipe.load_result(tmp_path / "a.npz")
    assert parts_of(loaded) == grid.parts and numpy.array_equal(loaded.label, grid.label)
    loaded.save(tmp_path / "b.npz")
    assert voxelpipe.load_result(tmp_path / "b.npz") == loaded
    if kind == "dense" and core_module.available():
        grid.save(tmp_path / "grid.vti")
        loaded.save(tmp_path / "loaded.vti")  # the core takes the table of a file as that of a request
        assert (tmp_path / "loaded.vti").read_bytes() == (tmp_path / "grid.vti").read_bytes()


@pytest.mark.filterwarnings("ignore:not_kept")
@pytest.mark.parametrize("extension", [one["extension"] for one in FORMATS if one["name"] not in ("npz", "png")])
def test_files_of_the_core_are_those_of_the_command_line(
    client: Client, cli: str, glb: pathlib.Path, extension: str
) -> None:
    options: dict[str, Any] = {"fill": "parity", "targets": "label:u8:replace"}
    grid = client.voxelize(GLB, resolution=40, parts="node", part_label="core=9", **options)
    grid.save(glb.with_name(f"a{extension}"))
    told_by(cli, glb, "--fill", "parity", "--target", "label:u8:replace", "-o", glb.with_name(f"b{extension}"))
    ours, theirs = (contents(glb.with_name(f"{name}{extension}")) for name in "ab")
    assert ours == theirs
    if extension == ".raw":
        described = [json.loads(glb.with_name(f"{name}.raw.json").read_text()) for name in "ab"]
        assert described[0]["hash"] == described[1]["hash"] == grid.sha256
        expected = parts_of(grid)._columns
        assert [*expected] == ["label", "priority", "triangles", "open_edges", "odd_columns", "voxels", "name"]
        assert described[0]["parts"] == expected == described[1].get("parts", expected)


RIGHT: dict[str, Any] = {
    "dims": numpy.array([2, 2, 2]),
    "origin": numpy.zeros(3),
    "voxel_size": numpy.ones(3),
    "target0": numpy.ones((2, 2, 2), "u1"),
    "part_label": numpy.array([1, 2], "u4"),
    "part_priority": numpy.array([0, -1], "i4"),
    "part_triangles": numpy.array([4, 5], "i8"),
    "part_open_edges": numpy.array([0, 1], "i8"),
    "part_odd_columns": numpy.array([0, 0], "i8"),
    "part_voxels": numpy.array([8, 0], "i8"),
    "part_name_offset": numpy.array([0, 1, 3], "i8"),
    "part_name": numpy.frombuffer(b"abc", "u1"),
}


@pytest.mark.parametrize(
    "changes, why",
    [
        ({"part_priority": None}, "it lacks 'part_priority'"),
        ({"part_open_edges": None}, "it lacks 'part_open_edges'"),
        ({"part_name": None}, "it lacks 'part_name'"),
        ({"part_voxels": None}, "it has 3 targets|'part_open_edges'"),
        ({"part_label": numpy.array([1, 2], "u8")}, "'part_label' is an array of uint64"),
        ({"part_label": numpy.array([[1, 2]], "u4")}, r"'part_label' is an array of uint32 of the shape \(1, 2\)"),
        ({"part_label": numpy.zeros(0, "u4")}, "0 parts"),
        ({"part_label": numpy.array([1, 0], "u4")}, r"part_label\[1\] is 0"),
        ({"part_voxels": numpy.array([1, -2], "i8")}, r"part_voxels\[1\] is"),
        ({"part_triangles": numpy.zeros(3, "i8")}, "'part_triangles' is an array"),
        ({"part_name_offset": numpy.array([0, 4, 3], "i8")}, "its part_name_offset does not ascend from 0 to 3"),
        ({"part_name_offset": numpy.array([0, 1], "i8")}, "'part_name_offset' is an array"),
        ({"part_name": numpy.array([["a"]])}, "'part_name' is an array of <U1"),
    ],
)
def test_other_tables_are_refused(tmp_path: pathlib.Path, changes: dict[str, Any], why: str) -> None:
    numpy.savez(tmp_path / "right.npz", **RIGHT)
    parts = parts_of(voxelpipe.load_result(tmp_path / "right.npz"))
    assert parts.name == ["a", "bc"] and parts["bc"] == Part(1, "bc", 2, -1, 5, 1, 0, 0)
    arrays = {name: array for name, array in (RIGHT | changes).items() if array is not None}
    numpy.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(ValueError, match=f"a.npz: no .npz of a result: .*({why})"):
        voxelpipe.load_result(tmp_path / "a.npz")


def test_damaged_tables_are_value_errors(tmp_path: pathlib.Path) -> None:
    numpy.savez(tmp_path / "right.npz", **RIGHT)
    right = (tmp_path / "right.npz").read_bytes()
    draw = numpy.random.default_rng(11)
    for _ in range(300):
        wrong = bytearray(right)
        for place in draw.integers(0, len(wrong), 4):
            wrong[place] = int(draw.integers(0, 256))
        (tmp_path / "a.npz").write_bytes(wrong)
        with contextlib.suppress(ValueError):
            voxelpipe.load_result(tmp_path / "a.npz")


def test_a_target_with_the_name_of_a_column_is_not_written(tmp_path: pathlib.Path) -> None:
    grid = voxelpipe.make_grid({"part_voxels": numpy.ones((2, 2, 2), "u1")})
    with pytest.raises(ValueError, match="'part_voxels' has the name of another array of an .npz"):
        grid.save(tmp_path / "a.npz")

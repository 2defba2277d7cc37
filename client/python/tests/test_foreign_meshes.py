"""Objects of other libraries, by what they document: polygons, strips, quadratic cells, colours, doubles."""
from __future__ import annotations

import pathlib
import types
from typing import Any

import numpy
import pytest

import voxelpipe
from voxelpipe import InvalidMesh, InvalidRequest, LocalServer, Mesh
from voxelpipe._calls.address import check_address
from voxelpipe._mesh.content import format_of
from voxelpipe._mesh.forms import load_mesh

from . import shapes

# The letter U in the plane z = 0, 7 unit squares, from each of its corners.
U = numpy.array([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], float)
U_POINTS = numpy.column_stack([U, numpy.zeros(len(U))])
SQUARES = {(0, 0), (1, 0), (2, 0), (0, 1), (2, 1), (0, 2), (2, 2)}
CODES = [200, 100, 50, 255]


def squares(client: voxelpipe.Client, mesh: Any) -> set[tuple[int, int]]:
    """The unit squares whose centres a flat mesh covers."""
    grid: Any = dict(voxel_size=1, dims=(3, 3, 1), origin=(0, 0, -0.5), coverage="center")
    return {(int(x), int(y)) for z, y, x in numpy.argwhere(client.voxelize(mesh, **grid).mask)}


def color(client: voxelpipe.Client, mesh: Any) -> list[int]:
    codes: list[int] = client.voxelize(mesh, resolution=6, targets="color:u8:encoding=srgb").dense()[0, 0, 0].tolist()
    return codes


@pytest.mark.parametrize("first", range(8))
def test_concave_polygons_of_meshio_are_covered_and_nothing_else(client: voxelpipe.Client, first: int) -> None:
    corners = numpy.roll(numpy.arange(8), -first)
    mesh = types.SimpleNamespace(points=U_POINTS, cells_dict={"polygon": corners[None, :]})
    assert squares(client, mesh) == SQUARES


def test_all_surface_cells_of_meshio_are_taken(client: voxelpipe.Client) -> None:
    flat = [(0, 0), (3, 0), (3, 1), (0, 1), (1, 1), (1, 3), (0, 3), (2, 1), (2, 3), (3, 3), (9, 9)]
    points = numpy.column_stack([numpy.array(flat, float), numpy.zeros(len(flat))])
    cells = [("triangle", [[0, 1, 2]]), ("line", [[0, 10]]), ("triangle", [[0, 2, 3]]), ("quad", [[3, 4, 5, 6]])]
    cells += [("polygon", [[7, 2, 9, 8]])]
    blocks = [types.SimpleNamespace(type=kind, data=numpy.array(data)) for kind, data in cells]
    assert squares(client, types.SimpleNamespace(points=points, cells=blocks, cells_dict={})) == SQUARES
    with pytest.raises(InvalidMesh, match="cells of the kind triangle10 are not read"):
        load_mesh(types.SimpleNamespace(points=points, cells_dict={"triangle10": numpy.zeros((1, 10), int)}))
    with pytest.raises(InvalidMesh, match="no triangles, quads or polygons, only: tetra"):
        load_mesh(types.SimpleNamespace(points=points, cells_dict={"tetra": numpy.zeros((1, 4), int)}))
    with pytest.raises(InvalidMesh, match="face 1 has the corner 99, and there are 11 vertices"):
        load_mesh(types.SimpleNamespace(points=points, cells_dict={"quad": numpy.array([[0, 1, 2, 3], [0, 1, 2, 99]])}))


@pytest.mark.parametrize(
    "kind, points",
    [
        ("triangle6", [(0, 0), (3, 0), (0, 3), (1.5, 0), (1.4, 1.4), (0, 1.5)]),
        ("triangle7", [(0, 0), (3, 0), (0, 3), (1.5, 0), (1.4, 1.4), (0, 1.5), (1, 1)]),
        ("quad8", [(0, 0), (3, 0), (3, 3), (0, 3), (1.5, 0), (3, 1.5), (1.5, 3), (0, 1.5)]),
        ("quad9", [(0, 0), (3, 0), (3, 3), (0, 3), (1.5, 0), (3, 1.5), (1.5, 3), (0, 1.5), (1.5, 1.5)]),
    ],
)
def test_quadratic_cells_are_split_at_their_middles(client: voxelpipe.Client, kind: str, points: Any) -> None:
    flat = numpy.column_stack([numpy.array(points, float), numpy.zeros(len(points))])
    mesh = types.SimpleNamespace(points=flat, cells_dict={kind: numpy.arange(len(points))[None, :]})
    whole = {(x, y) for x in range(3) for y in range(3)}
    expected = whole if kind.startswith("quad") else {(x, y) for x, y in whole if x + y < 2}
    assert squares(client, mesh) == expected


def test_polygons_strips_and_colors_of_vtk_are_taken(client: voxelpipe.Client) -> None:
    pytest.importorskip("vtkmodules")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    def data(points: Any, polygons: list[list[int]], strips: list[list[int]]) -> Any:
        mesh, vertices = vtkPolyData(), vtkPoints()
        vertices.SetData(numpy_to_vtk(numpy.array(points, float), deep=True))
        mesh.SetPoints(vertices)
        for cells, place in ((polygons, mesh.SetPolys), (strips, mesh.SetStrips)):
            array = vtkCellArray()
            for cell in cells:
                array.InsertNextCell(len(cell), cell)
            place(array)
        return mesh

    assert squares(client, data(U_POINTS, [list(range(8))], [])) == SQUARES
    lower = [(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0), (2, 0, 0), (2, 1, 0), (3, 0, 0), (3, 1, 0)]
    upper = [(0, 3, 0), (1, 3, 0), (2, 3, 0), (3, 3, 0)]
    strips = data(lower + upper, [[1, 3, 9, 8], [5, 7, 11, 10]], [[0, 1, 2, 3, 4, 5, 6, 7]])
    assert squares(client, strips) == SQUARES
    turned = client.voxelize(strips, voxel_size=1, dims=(3, 1, 1), origin=(0, 0, -0.5), targets="normal:f32")
    assert len(set(numpy.sign(turned.dense()[..., 2]).ravel())) == 1, "the winding alternates along a strip"
    strips.GetPointData().SetScalars(numpy_to_vtk(numpy.array([CODES[:3]] * 12, numpy.uint8), deep=True))
    assert color(client, strips) == CODES
    strips.GetPointData().SetScalars(numpy_to_vtk(numpy.arange(12.0), deep=True))
    assert color(client, strips) == [255] * 4, "a quantity is no colour"


def test_concave_quads_of_arrays_are_split_where_that_lies_inside(client: voxelpipe.Client) -> None:
    dart = numpy.array([(0, 0, 0), (3, 0, 0), (1, 1, 0), (0, 3, 0)], float)
    for first in range(4):
        faces = numpy.roll(numpy.arange(4), -first)[None, :]
        assert (1, 1) not in squares(client, (dart, faces)) and (0, 0) in squares(client, (dart, faces))


def test_colors_of_other_libraries_are_srgb_as_in_a_file(client: voxelpipe.Client, tmp_path: pathlib.Path) -> None:
    vertices, faces = shapes.TETRAHEDRON
    codes = numpy.array([CODES] * len(vertices), numpy.uint8)
    trimesh = types.SimpleNamespace(
        vertices=vertices, faces=faces, visual=types.SimpleNamespace(kind="vertex", vertex_colors=codes)
    )
    open3d = types.SimpleNamespace(
        vertices=vertices, triangles=faces, has_vertex_colors=lambda: True, vertex_colors=codes[:, :3] / 255
    )
    path = tmp_path / "coloured.ply"
    rows = [f"{x} {y} {z} 200 100 50" for x, y, z in vertices] + [f"3 {a} {b} {c}" for a, b, c in faces]
    head = "ply\nformat ascii 1.0\nelement vertex 4\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    head += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    path.write_text(head + "element face 4\nproperty list uchar int vertex_indices\nend_header\n" + "\n".join(rows))
    arrays = [Mesh(vertices, faces, colors=given) for given in (codes, codes.tolist())]
    for mesh in (trimesh, open3d, path, *arrays):
        assert color(client, mesh) == CODES


@pytest.mark.parametrize("wrong", [[[256, 0, 0]] * 4, [[-1, 0, 0]] * 4, [[1.5, 0, 0]] * 4, [[float("nan"), 0, 0]] * 4])
def test_colors_out_of_range_are_named(wrong: Any) -> None:
    with pytest.raises(InvalidMesh, match=r"colors\[0\] is .*from 0 to") as caught:
        load_mesh(Mesh(*shapes.TETRAHEDRON, colors=wrong))
    assert caught.value.field == "colors"


def test_doubles_are_kept(client: voxelpipe.Client, tmp_path: pathlib.Path) -> None:
    origin = numpy.array([701362.1, 4485513.2, 812.3])
    vertices = origin + numpy.array([(0, 0, 0), (3.3, 0, 0.4), (0.1, 3.2, 1.7)])
    path = tmp_path / "survey.obj"
    path.write_text("".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist()) + "f 1 2 3\n")
    grid: Any = dict(voxel_size=0.1, dims=(34, 34, 18), origin=tuple(origin - 0.05))
    of_file, of_arrays = client.voxelize(path, **grid).mask, client.voxelize((vertices, [[0, 1, 2]]), **grid).mask
    assert of_file.sum() > 300 and numpy.array_equal(of_file, of_arrays)
    rounded = client.voxelize((vertices.astype("f4"), [[0, 1, 2]]), **grid).mask
    assert not numpy.array_equal(of_file, rounded)


def test_a_paths_extension_counts_where_the_content_shows_nothing(
    client: voxelpipe.Client, tmp_path: pathlib.Path
) -> None:
    triangle = numpy.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], "<f4").tobytes()
    trailing = tmp_path / "trailing.STL"
    trailing.write_bytes(b"\0" * 80 + b"\1\0\0\0" + b"\0" * 12 + triangle + b"\0\0" + b"extra")
    assert client.voxelize(trailing, resolution=4).warnings[0].code == "nonconforming_file"
    bare = tmp_path / "bare.off"
    bare.write_text("3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    assert client.voxelize(bare, resolution=4).mask.any()
    with open(bare, "rb") as file:  # a file object has a name too
        assert client.voxelize(file, resolution=4).mask.any()
    named_wrong = tmp_path / "scene.stl"
    named_wrong.write_text("# a comment\ng part\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert client.voxelize(named_wrong, resolution=4).mask.any()


@pytest.mark.parametrize(
    "text",
    [b"glTF", b"DRACO", b"PK\3\4", b"{}", b" \n{", b"ply\n", b"solid x", b"SOLID", b"# c\nOFF\n", b"STCNOFF 3"]
    + [b"OFF8 6 12", b"\xef\xbb\xbfply\n", b"o a\nv 0 0 0", b"mtllib a", b"4nOFF"],
)
def test_contents_that_show_a_format(text: bytes) -> None:
    assert format_of(pathlib.Path("a.3mf"), memoryview(text)) == 0


@pytest.mark.parametrize("text", [b"", b"plyx", b"3 1 0", b"vertex 1", b"OFFX", b"# only a comment"])
def test_contents_that_show_none(text: bytes) -> None:
    assert format_of(pathlib.Path("a.3mf"), memoryview(text)) == load_mesh(b"", format="3mf").format
    assert format_of(pathlib.Path("a.unknown"), memoryview(text)) == 0


# Also where the package voxelpipe_core runs them.
@pytest.mark.parametrize("served", [True, False])
@pytest.mark.parametrize(
    "data, field",
    [
        (b"no mesh at all", "mesh"),
        (b"DRACO\2\2\0\0\0\0", "draco"),
        (b"ply\nformat", "PLY"),
        (b"glTF\2\0\0\0", "GLB"),
        (b'{"asset": 1}', "glTF"),
        (b"OFF\n1", "OFF"),
        (b"f 1 2 3\n", "OBJ"),
        (b"solid\nvertex 1", "STL"),
        (b"PK\3\4 3D/ and nothing else", "3MF"),
    ],
)
def test_a_mesh_that_cannot_be_read_is_an_invalid_mesh(
    client: voxelpipe.Client, monkeypatch: pytest.MonkeyPatch, data: bytes, field: str, served: bool
) -> None:
    if not served:
        pytest.importorskip("voxelpipe_core")
        monkeypatch.delenv("VOXELPIPE_SERVER", raising=False)
    with pytest.raises(InvalidMesh) as caught:
        if served:
            client.voxelize(data, resolution=4)
        else:
            voxelpipe.voxelize(data, resolution=4)
    assert caught.value.field.startswith(field)


def test_an_invalid_mesh_names_its_file(client: voxelpipe.Client, tmp_path: pathlib.Path) -> None:
    path = tmp_path / "wrong.ply"
    path.write_text("ply\nformat ascii 1.0\nelement vertex 1\nend_header\n")
    calls: list[Any] = [client.voxelize, client.upload, client.estimate]
    for call in calls:
        with pytest.raises(InvalidMesh) as caught:
            call(path)
        assert caught.value.message.startswith(f"{path}: PLY: ") and caught.value.field == "PLY"
    (error,) = client.voxelize_many([path], errors="return")
    assert isinstance(error, InvalidMesh) and error.message.startswith(f"{path}: PLY: ")


def test_a_list_of_files_is_told_of_voxelize_many() -> None:
    with pytest.raises(TypeError, match="voxelize_many"):
        load_mesh(["a.glb", "b.glb"])


def test_dense_of_a_sparse_result_has_the_clear_of_a_dense_one(client: voxelpipe.Client) -> None:
    for target in ("u16:clear=70000", "u8:clear=2.5", "u8:clear=-3", "f16:clear=0.1"):
        options: Any = dict(resolution=5, padding=1, targets=f"position:{target}")
        dense = client.voxelize(shapes.TETRAHEDRON, **options)
        sparse = client.voxelize(shapes.TETRAHEDRON, result="sparse", **options)
        assert numpy.array_equal(dense.dense(), sparse.dense()), target


def test_a_local_server_and_a_client_are_servers(server: LocalServer, client: voxelpipe.Client) -> None:
    servers: list[Any] = [server, client, server.server]
    for given in servers:
        assert voxelpipe.voxelize(shapes.TETRAHEDRON, resolution=4, server=given).mask.any()
    with voxelpipe.Client(server) as opened:
        assert opened.server == server.server
    with pytest.raises(TypeError, match="a int is no address"):
        voxelpipe.voxelize(shapes.TETRAHEDRON, server=3)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "address, why",
    [
        ("localhost", "has no port"),
        ("http://localhost:50051", "is a URL"),
        ("localhost:", "has the port ''"),
        ("localhost:port", "has the port 'port'"),
        ("localhost:0", "has the port '0'"),
        ("localhost:65536", "has the port '65536'"),
        (":50051", "has no host"),
        ("::1", "has more than one colon"),
        ("[::1]", "has no port"),
        ("dns:///localhost", "has no port"),
        ("", "has no port"),
    ],
)
def test_addresses_that_no_server_has_are_refused(address: str, why: str) -> None:
    with pytest.raises(InvalidRequest) as caught:
        check_address(address)
    assert why in caught.value.message and caught.value.field == "server"


@pytest.mark.parametrize(
    "address",
    ["localhost:1", "[::1]:50051", "unix:/tmp/a", "unix:///tmp/a", "dns:///a:443", "dns:a:443", "ipv4:1.2.3.4:5"],
)
def test_addresses_of_grpc_are_taken(address: str) -> None:
    check_address(address)

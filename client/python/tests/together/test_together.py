"""Several meshes on one grid: voxelize(..., together=True)."""
from __future__ import annotations

import asyncio
import pathlib
import threading
from typing import Any

import numpy
import pytest

import voxelpipe
from voxelpipe import Client, InProcessClient, InvalidRequest, LocalServer, Mesh, Motion, VoxelGrid
from voxelpipe._calls import core_module, server_calls
from voxelpipe._mesh.placed import PlacedMeshes, Together, placed_meshes
from voxelpipe._proto.voxelpipe.v1 import request_pb2

from .. import shapes
from ..test_formats import RED_PNG

REQUESTS: list[dict[str, Any]] = [
    {"voxel_size": 0.07},
    {"resolution": 40, "fill": "nonzero", "normal": "normal:f32"},
    {"voxel_size": 0.1, "result": "sparse", "targets": ["u32:max:shader=triangle_id", "f32x3:average:shader=normal"]},
    {"dims": (20, 30, 40), "result": "buckets", "coverage": "thin", "targets": "u32:replace:shader=triangle_id"},
]


def matrix(turn: float = 0.0, move: tuple[float, float, float] = (0, 0, 0), scale: float = 1.0) -> shapes.Array:
    """A turn about z, after a scale and before a move."""
    cos, sin = scale * numpy.cos(turn), scale * numpy.sin(turn)
    x, y, z = move
    return numpy.array([[cos, -sin, 0, x], [sin, cos, 0, y], [0, 0, scale, z], [0, 0, 0, 1]])


MIRROR = numpy.diag([-1.0, 1, 1, 1])


def merged(*placed: tuple[shapes.Triangles, shapes.Array]) -> Mesh:
    """One mesh of several, each with its matrix, by the definition: M p in double, a row from the left to the right."""
    vertices, faces, first = [], [], 0
    for (points, triangles), m in placed:
        x, y, z = points.T
        vertices.append(numpy.stack([((r[0] * x + r[1] * y) + r[2] * z) + r[3] for r in m[:3]], axis=1))
        mirrored = numpy.linalg.det(m[:3, :3]) < 0
        faces.append((triangles[:, [0, 2, 1]] if mirrored else triangles) + first)
        first += len(points)
    return Mesh(numpy.concatenate(vertices), numpy.concatenate(faces))


@pytest.mark.parametrize("options", REQUESTS)
def test_the_bytes_are_those_of_one_merged_mesh(client: Client, ball: shapes.Triangles, options: Any) -> None:
    a, b = shapes.TETRAHEDRON, ball
    first, second = matrix(0.3, (0.1, 0.2, 0.3)), matrix(1.1, (-2.5, 0.75, 1), 0.7)
    third = MIRROR @ matrix(2, (1, 0, 2))
    options = {"coverage": "conservative"} | options
    together = client.voxelize([a, b, a], together=True, transforms=[first, second, third], **options)
    assert together == client.voxelize(merged((a, first), (b, second), (a, third)), **options)
    assert together.summary.occupied > 100


def test_identity_is_the_mesh_alone(client: Client, ball: shapes.Triangles) -> None:
    options: dict[str, Any] = {"resolution": 30, "fill": "parity", "normal": "normal:f32", "p": "position:f32"}
    alone = client.voxelize(ball, **options)
    for transforms in (None, [None], [numpy.eye(4)], numpy.eye(4)[None], [numpy.eye(4).ravel().tolist()]):
        assert client.voxelize([ball], together=True, transforms=transforms, **options) == alone
    assert client.voxelize([ball], together=True, transforms=[numpy.eye(4).tolist()], **options) == alone
    assert alone.summary.mesh == client.voxelize([ball], together=True, **options).summary.mesh


def test_a_mirror_turns_the_triangles(client: Client) -> None:
    options: dict[str, Any] = {"voxel_size": 0.05, "n": "geometric_normal:f32", "fill": "nonzero"}
    vertices, faces = shapes.TETRAHEDRON
    mirrored = client.voxelize([shapes.TETRAHEDRON], together=True, transforms=[MIRROR], **options)
    assert mirrored == client.voxelize((vertices * (-1, 1, 1), faces[:, [0, 2, 1]]), **options)
    inward = client.voxelize((vertices * (-1, 1, 1), faces), **options)
    assert numpy.array_equal(mirrored.mask, inward.mask) and not numpy.array_equal(mirrored["n"], inward["n"])


def test_the_same_mesh_stands_twice(client: Client, tmp_path: pathlib.Path) -> None:
    path = tmp_path / "part.glb"
    path.write_bytes(bytes(voxelpipe.load_mesh(shapes.TETRAHEDRON).data))
    there = matrix(move=(3, 0, 0))
    expected = client.voxelize(merged((shapes.TETRAHEDRON, numpy.eye(4)), (shapes.TETRAHEDRON, there)), resolution=50)
    file, handle = voxelpipe.load_mesh(path), client.upload(path)
    forms: list[Any] = [path, str(path), path.read_bytes(), shapes.TETRAHEDRON, file, handle, handle.stored]
    for form in forms:
        assert client.voxelize([form, form], together=True, transforms=[None, there], resolution=50) == expected
    assert client.voxelize((path, handle), together=True, transforms=[None, there], resolution=50) == expected
    with open(path, "rb") as opened:  # read once
        assert client.voxelize([opened] * 2, together=True, transforms=[None, there], resolution=50) == expected


def place(meshes: Any, **options: Any) -> PlacedMeshes:
    names = ("transforms", "names", "labels", "priorities", "motions")
    return placed_meshes(meshes, Together(**{name: options.get(name) for name in names}), lambda mesh: None)


def textured(folder: pathlib.Path, size: int) -> pathlib.Path:
    """An OBJ file of a square with a red texture."""
    folder.mkdir()
    (folder / "red.png").write_bytes(RED_PNG)
    (folder / "a.mtl").write_text("newmtl a\nmap_Kd red.png\n")
    corners = "".join(f"v {size * x} {size * y} {size}\nvt {x} {y}\n" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
    (folder / "a.obj").write_text(f"mtllib a.mtl\nusemtl a\n{corners}f 1/1 2/2 3/3 4/4\n")
    return folder / "a.obj"


def test_a_mesh_is_read_once_by_its_content(tmp_path: pathlib.Path) -> None:
    data = bytes(voxelpipe.load_mesh(shapes.cube()).data)
    for name in ("a.glb", "b.glb"):
        (tmp_path / name).write_bytes(data)
    placed = place([tmp_path / "a.glb", tmp_path / "b.glb", data, shapes.TETRAHEDRON, tmp_path / "a.glb"])
    assert placed.of == (0, 0, 0, 1, 0) and len(placed.sources) == 2
    assert placed.names[:2] == ("a.glb", "b.glb") and placed.names[4] == "a.glb"
    assert placed.names[2:4] == tuple(source.name for source in placed.sources)
    assert placed.labels == (None,) * 5 and placed.priorities == (0,) * 5 and placed.motions == (None,) * 5


def test_the_message_has_what_was_given() -> None:
    m = matrix(0.5, (1, 2, 3))
    spin = Motion(angular=numpy.array([0, 0, 1]), center=[4, 5, 6])
    placed = place(
        [shapes.TETRAHEDRON, shapes.cube()],
        transforms=[None, m],
        names=["hull", None],
        labels=numpy.array([7, 2**32 - 1]),
        priorities=[-5, None],
        motions=[{"linear": (1, 2, 3)}, spin],
    )
    first, second = request_pb2.PlacedMeshes.FromString(placed.message()).meshes
    assert first.matrix == numpy.eye(4).ravel().tolist() and second.matrix == m.ravel().tolist()
    assert (first.name, first.label, first.priority) == ("hull", 7, -5)
    assert (second.name, second.label, second.priority) == (second.mesh, 2**32 - 1, 0)
    assert first.motion.linear.z == 3 and first.motion.HasField("angular") and second.motion.center.y == 5
    (only,) = request_pb2.PlacedMeshes.FromString(place([shapes.cube()]).message()).meshes
    assert not only.HasField("label") and not only.HasField("motion")


ONE, TWO = [shapes.TETRAHEDRON], [shapes.TETRAHEDRON] * 2
BENT = numpy.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [1, 2, 3, 1]])


@pytest.mark.parametrize(
    "meshes, options, field, why",
    [
        (TWO, {"names": ["a"]}, "names", "1 of them for 2 meshes"),
        (ONE, {"names": "a"}, "names", "'a' is no list"),
        (TWO, {"names": ["a", 5]}, "names[1]", "5 is no text"),
        (ONE, {"names": ["\ud800"]}, "names[0]", "cannot be written as UTF-8"),
        (ONE, {"labels": [1, 2]}, "labels", "2 of them for 1 mesh"),
        (ONE, {"labels": 5}, "labels", "5 is no list"),
        (ONE, {"labels": {0: 5}}, "labels", "is no list"),
        (ONE, {"labels": {5}}, "labels", "is no list"),
        (TWO, {"labels": [1, 0]}, "labels[1]", "0 is not from 1 to 4294967295"),
        (ONE, {"labels": [2**32]}, "labels[0]", "is not from 1"),
        (ONE, {"labels": [1.5]}, "labels[0]", "1.5 is no whole number"),
        (ONE, {"labels": [True]}, "labels[0]", "True is no whole number"),
        (ONE, {"labels": ["7"]}, "labels[0]", "'7' is no whole number"),
        (ONE, {"priorities": [2**31]}, "priorities[0]", "is not from -2147483648"),
        (ONE, {"priorities": []}, "priorities", "0 of them for 1 mesh"),
        (ONE, {"transforms": numpy.eye(4)}, "transforms", "4 of them for 1 mesh"),
        (ONE, {"transforms": [numpy.eye(3)]}, "transforms[0]", r"it is of the shape \(3, 3\)"),
        (ONE, {"transforms": ["1,0,0"]}, "transforms[0]", "no array of numbers"),
        (ONE, {"transforms": [[[1, 2], [3]]]}, "transforms[0]", "no array of numbers"),
        (ONE, {"transforms": [numpy.eye(4) * numpy.nan]}, "transforms[0]", "number 0 is nan"),
        (ONE, {"transforms": [BENT]}, "transforms[0]", "the last row is 1 2 3 1, expected 0 0 0 1"),
        (ONE, {"motions": [{"linaer": (0, 0, 0)}]}, "motions[0]", "'linaer' is none of linear, angular, center"),
        (ONE, {"motions": [7]}, "motions[0]", "7 is neither a Motion nor a mapping"),
        (ONE, {"motions": [Motion(linear=(1, 2))]}, "motions[0].linear", "are not three numbers"),
        (ONE, {"motions": [{"center": (0, 0, numpy.inf)}]}, "motions[0].center", "are not three numbers"),
        ([], {}, "together", "0 meshes; 1 to 65535 are possible"),
        (ONE * 65_536, {}, "together", "65536 meshes; 1 to 65535 are possible"),
        ("a.glb", {}, "together", "a str is none"),
        (7, {}, "together", "a int is none"),
        ({"a": shapes.TETRAHEDRON}, {}, "together", "a dict is none"),
        (ONE, {"together": 1}, "together", "1 is neither True nor False"),
        (ONE, {"new_positions": numpy.zeros((4, 3))}, "new_positions", "several meshes"),
    ],
)
def test_wrong_options_are_named(client: Client, meshes: Any, options: dict[str, Any], field: str, why: str) -> None:
    asked: dict[str, Any] = {"together": True, "resolution": 8} | options
    with pytest.raises(InvalidRequest, match=why) as caught:
        client.voxelize(meshes, **asked)
    assert caught.value.field == field and caught.value.message.startswith(f"{field}: ")


@pytest.mark.parametrize("name", ["transforms", "names", "labels", "priorities", "motions"])
def test_lists_need_together(client: Client, name: str) -> None:
    options: dict[str, Any] = {name: [None]}
    why = f"^{name}: is for several meshes on one grid; give together=True too$"
    with pytest.raises(InvalidRequest, match=why) as caught:
        client.voxelize(shapes.TETRAHEDRON, **options)
    assert caught.value.field == name


def test_without_together_a_list_is_no_mesh(client: Client) -> None:
    with pytest.raises(TypeError, match="a list of files is no mesh"):
        client.voxelize(["a.glb", "b.glb"])
    refused: list[dict[str, Any]] = [{"together": True}, {"labels": [1]}]
    for several in refused:
        with pytest.raises(voxelpipe.UnknownOption, match="this call has no such option"):
            client.voxelize_many([shapes.cube()], **several)


def test_a_wrong_mesh_is_named(client: Client, tmp_path: pathlib.Path) -> None:
    cube, bad = shapes.cube(), tmp_path / "bad.glb"
    bad.write_bytes(b"nonsense")
    with pytest.raises(TypeError, match=r"^meshes\[1\]: a builtins.int is no mesh"):
        client.voxelize([cube, 3], together=True)
    with pytest.raises(voxelpipe.InvalidMesh, match=r"^meshes\[1\]: faces"):
        client.voxelize([cube, (cube[0], cube[1] + 9)], together=True)
    with pytest.raises(FileNotFoundError):
        client.voxelize([cube, tmp_path / "none.glb"], together=True)
    with pytest.raises(voxelpipe.InvalidMesh, match=f"^{bad}: "):
        client.voxelize([cube, bad], together=True)
    with pytest.raises(voxelpipe.InvalidMesh, match=r"^meshes\[2\]: "):
        client.voxelize([cube, cube, b"nonsense"], together=True)


def test_a_flat_matrix_is_refused_by_the_core(client: Client) -> None:
    with pytest.raises(InvalidRequest, match="singular") as caught:
        client.voxelize(TWO, together=True, transforms=[None, numpy.diag([1.0, 1, 0, 1])], resolution=8)
    assert caught.value.field == "mesh.placed.meshes[1].matrix"


def test_motions_give_velocities(client: Client) -> None:
    spin, move = Motion(angular=(0, 0, 2), center=(0.5, 0.5, 0)), {"linear": (1, 2, 3)}
    grid = client.voxelize(
        [shapes.cube()] * 3,
        together=True,
        transforms=[None, matrix(move=(5, 0, 0)), matrix(move=(10, 0, 0))],
        motions=[spin, move, None],
        voxel_size=0.25,
        velocity="velocity:f32x3",
    )
    i = numpy.arange(grid.dims[0])
    at = grid.velocity[:, :, i < 6][grid.mask[:, :, i < 6]]
    places = grid.world(grid.occupied())
    first = places[places[:, 0] < 2]
    assert len(at) == len(first) and 0.5 < numpy.abs(at).max() < 2 and not at[:, 2].any()
    second = grid.velocity[grid.mask & (i > 18) & (i < 26)]
    assert len(second) and (second == (1, 2, 3)).all()
    assert not grid.velocity[grid.mask & (i > 38)].any()


class Core:
    """The core's module, with the names of the meshes that are loaded."""

    def __init__(self, core: Any) -> None:
        self._core = core
        self.loaded: list[str] = []

    def load(self, mesh: Any, format: int, unit: int, name: str, *rest: Any) -> Any:
        self.loaded.append(name)
        return self._core.load(mesh, format, unit, name, *rest)

    def load_all(self, meshes: Any, timeout: float) -> Any:
        self.loaded += [name for *_, name in meshes]
        return self._core.load_all(meshes, timeout)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._core, name)


@pytest.mark.skipif(not core_module.available(), reason="voxelpipe_core is not installed")
def test_in_this_process_meshes_stay_loaded(monkeypatch: pytest.MonkeyPatch, ball: shapes.Triangles) -> None:
    core = Core(core_module.core)
    monkeypatch.setattr(core_module, "core", core)
    with InProcessClient() as inside:
        handle = inside.upload(ball)
        files = [voxelpipe.load_mesh(mesh) for mesh in (shapes.cube(), shapes.TETRAHEDRON)]
        grids: list[VoxelGrid] = []
        for frame in range(4):
            moves = [None, matrix(0.1 * frame, (3, 0, 0)), MIRROR, matrix(move=(0, 3, 0))]
            grids.append(inside.voxelize([handle, *files, files[0]], together=True, transforms=moves, resolution=20))
        assert core.loaded == [handle.name, *(file.stored_name() for file in files)]
        assert grids[0] != grids[1] and [mesh.name for mesh in inside.meshes()] == [handle.name]
        again = voxelpipe.load_mesh(shapes.cube())
        assert inside.voxelize([again], together=True, resolution=4) == inside.voxelize(again, resolution=4)
        assert core.loaded[3:] == [again.stored_name()]
        inside.release_mesh(handle)
        assert inside.voxelize([handle], together=True, resolution=4) == inside.voxelize(ball, resolution=4)
        inside.release_mesh(handle)
        with pytest.raises(voxelpipe.MeshNotFound):
            inside.voxelize([handle.stored], together=True)


@pytest.mark.skipif(not core_module.available(), reason="voxelpipe_core is not installed")
def test_bytes_that_change_are_loaded_again() -> None:
    data = bytearray(voxelpipe.load_mesh(shapes.cube()).data)
    file = voxelpipe.load_mesh(data)
    with InProcessClient() as inside:
        before = inside.voxelize([file], together=True, voxel_size=0.5)
        at = data.index(numpy.float32(1).tobytes(), data.index(b"BIN"))
        data[at : at + 4] = numpy.float32(3).tobytes()
        after = inside.voxelize([file], together=True, voxel_size=0.5)
        assert after != before and after == inside.voxelize(bytes(data), voxel_size=0.5)


@pytest.mark.skipif(not core_module.available(), reason="voxelpipe_core is not installed")
def test_threads_place_meshes_with_textures_in_any_order(tmp_path: pathlib.Path) -> None:
    files = [textured(tmp_path / f"{size}", size) for size in (1, 2, 3)]
    orders = [(0, 1, 2), (2, 1, 0), (1, 2, 0)] * 2
    expected: dict[tuple[int, ...], VoxelGrid] = {}
    for _ in range(5):
        with InProcessClient() as inside:
            handles = [inside.upload(file) for file in files]  # whose textures the first that needs them decodes
            got: list[tuple[tuple[int, ...], VoxelGrid]] = []

            def run(order: tuple[int, ...]) -> None:
                listed = [handles[i] for i in order]
                got.append((order, inside.voxelize(listed, together=True, resolution=12, color="base_color:srgb8")))

            threads = [threading.Thread(target=run, args=(order,), daemon=True) for order in orders]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join(60)
            assert len(got) == len(orders)
        for order, grid in got:
            assert expected.setdefault(order, grid) == grid and (grid.color[grid.mask][:, 0] > 200).any()


def test_a_server_is_sent_each_mesh_once(
    server: LocalServer, ball: shapes.Triangles, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[str] = []
    with server.client() as client:
        calls = client._calls
        upload = calls._upload

        async def noted(file: Any, deadline: Any, reporter: Any, name: str = "") -> Any:
            sent.append(name)
            return await upload(file, deadline, reporter, name)

        monkeypatch.setattr(calls, "_upload", noted)
        cube = voxelpipe.load_mesh(shapes.cube())
        for frame in range(3):
            move = matrix(move=(2 + frame, 0, 0))
            client.voxelize([ball, cube, ball], together=True, transforms=[None, move, move], resolution=16)
        assert sent == [voxelpipe.load_mesh(ball).stored_name(), cube.stored_name()]
        client.release_mesh(cube.stored_name())
        client.voxelize([ball, cube], together=True, resolution=16)
        assert cube.stored_name() in [mesh.name for mesh in client.meshes()], "stored again"


def test_an_older_server_is_named(server: LocalServer, monkeypatch: pytest.MonkeyPatch) -> None:
    with server.client() as client:
        revision = client.server_info().contract_revision
        monkeypatch.setattr(server_calls, "_PLACED_REVISION", revision + 1)
        with pytest.raises(voxelpipe.errors.NotSupported, match=f"revision {revision} .* need revision {revision + 1}"):
            client.voxelize([shapes.cube()], together=True)


@pytest.mark.skipif(not core_module.available(), reason="voxelpipe_core is not installed")
@pytest.mark.parametrize("options", [*REQUESTS, {"resolution": 30, "velocity": "velocity:f32"}])
def test_a_server_gives_the_bytes_of_this_process(server: LocalServer, ball: shapes.Triangles, options: Any) -> None:
    several: dict[str, Any] = {
        "together": True,
        "transforms": [matrix(0.2), MIRROR, matrix(1, (2, 0, 0), 0.5)],
        "motions": [Motion((1, 0, 0)), None, {"angular": [0, 0, 1]}],
        "labels": [3, 1, 2],
        "priorities": [0, 5, -5],
        "names": ["a", "b", "a"],
    }
    meshes = [ball, shapes.cube(), ball]
    with InProcessClient() as inside, server.client() as client:
        here, there = inside.voxelize(meshes, **several, **options), client.voxelize(meshes, **several, **options)
        assert here == there and here.summary.mesh == there.summary.mesh and here.warnings == there.warnings
        estimates = [one.estimate(meshes, **several, **options) for one in (inside, client)]
        assert estimates[0].place == estimates[1].place == here.place and estimates[0].mesh == estimates[1].mesh

    async def asked(address: str) -> VoxelGrid:
        async with voxelpipe.AsyncClient(address) as other:
            return await other.voxelize(meshes, **several, **options)

    assert asyncio.run(asked(server.server)) == here
    assert voxelpipe.voxelize(meshes, server=server, **several, **options) == here


def test_the_guides_frames(server: LocalServer, monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path) -> None:
    readme = pathlib.Path(__file__).resolve().parents[2] / "README.md"
    section = readme.read_text(encoding="utf-8").partition("## Several meshes on one grid")[2]
    block = section.partition("```python\n")[2].partition("```")[0]
    (tmp_path / "bunny.glb").write_bytes(bytes(voxelpipe.load_mesh(shapes.ball()).data))
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"voxelpipe": voxelpipe}
    exec(block, names)
    last: VoxelGrid = names["r"]
    speed = numpy.linalg.norm(last.velocity[last.mask], axis=1)
    assert last.dims == (64, 26, 26) and 2.9 < speed.max() < 3.3 and (speed == 0).any()


@pytest.mark.skipif(not core_module.available(), reason="voxelpipe_core is not installed")
def test_at_module_level_and_with_asyncio_no_server_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VOXELPIPE_SERVER", raising=False)
    expected = voxelpipe.voxelize([shapes.cube()] * 2, together=True, transforms=[None, MIRROR], resolution=12)
    assert expected.dims == (12, 6, 6)

    async def asked() -> VoxelGrid:
        async with voxelpipe.AsyncClient() as other:
            return await other.voxelize([shapes.cube()] * 2, together=True, transforms=[None, MIRROR], resolution=12)

    assert asyncio.run(asked()) == expected

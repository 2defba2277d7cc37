"""Files of results by voxelpipe_core: the bytes of the command line, what is refused, warned of and interrupted."""
from __future__ import annotations

import gzip
import os
import pathlib
import pickle
import signal
import subprocess
import threading
import time
import warnings
import webbrowser
from typing import Any, Iterator

import numpy
import pytest

import voxelpipe
from voxelpipe import VoxelGrid
from voxelpipe._calls import core_module
from voxelpipe._export import save
from voxelpipe.local_server import LocalServer

from . import shapes

FORMATS: list[dict[str, Any]] = core_module.core.formats() if core_module.available() else []
pytestmark = pytest.mark.skipif(not FORMATS, reason="voxelpipe_core is not installed")

COLOR = "u8x4:replace:shader=base_color,encoding=srgb"
ONE = {"dense": [COLOR], "sparse": ["f32x3:average:shader=normal"], "buckets": ["u32:replace:shader=triangle_id"]}
ONE_NUMBER = {".seg.nrrd": ["u16:max:shader=triangle_id"], ".h5": ["f32:max:shader=triangle_id"]}  # hold no vectors
SEVERAL = ["bit:or:shader=occupancy", COLOR, "f16x3:replace:shader=normal", "u32:replace:shader=triangle_id"]


def cases() -> Iterator[Any]:
    """Extension, kind of result, targets, layout: each format with all that it holds."""
    for one in FORMATS:
        if one["extension"] in save._OWN:
            continue
        for kind in one["kinds"]:
            single = ONE_NUMBER.get(one["extension"], ONE[kind])
            for targets in [single, SEVERAL] if one["targets"] != "one" else [single, SEVERAL[:1]]:
                for layout in ("interleaved", "planar"):
                    name = f"{one['name']}-{kind}-{len(targets)}-{layout}-{targets[0].partition(':')[0]}"
                    yield pytest.param(one["extension"], kind, targets, layout, id=name)


def contents(path: pathlib.Path) -> dict[str, bytes]:
    """The files of a result by their names: one, or those of a directory."""
    if path.is_file():
        return {"": path.read_bytes()}
    return {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}


@pytest.fixture(autouse=True)
def without_server(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VOXELPIPE_SERVER", raising=False)


@pytest.fixture(scope="module")
def mesh(ball: shapes.Triangles, tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    path = tmp_path_factory.mktemp("mesh") / "ball.glb"
    path.write_bytes(bytes(voxelpipe.load_mesh(ball).data))
    return path


@pytest.fixture()
def grid(mesh: pathlib.Path) -> VoxelGrid:
    return voxelpipe.voxelize(mesh, resolution=12, targets=[COLOR])


@pytest.fixture()
def out(tmp_path: pathlib.Path) -> pathlib.Path:
    """A folder that is empty."""
    (tmp_path / "out").mkdir()
    return tmp_path / "out"


def test_the_registry_has_the_formats_that_are_written_here() -> None:
    assert {*save._OWN} < {one["extension"] for one in FORMATS}
    assert [one["extension"] for one in FORMATS if one["picture"]] == [".png"]


def test_the_longest_extension_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    more = [*FORMATS, {**FORMATS[0], "extension": ".second.vti"}]
    monkeypatch.setattr(core_module.core, "formats", lambda: more)
    for name, extension in {"a.second.VTI": ".second.vti", "second.vti": ".vti", ".second.vti": ".vti"}.items():
        assert save._extension(pathlib.Path(name)) == extension


@pytest.mark.filterwarnings("ignore:not_kept")
@pytest.mark.parametrize("extension, kind, targets, layout", cases())
def test_the_file_is_that_of_the_command_line(
    server: LocalServer,
    cli: str,
    mesh: pathlib.Path,
    out: pathlib.Path,
    extension: str,
    kind: Any,
    targets: list[str],
    layout: Any,
) -> None:
    theirs = out / f"cli{extension}"
    arguments = [argument for target in targets for argument in ("--target", target)]
    command = [cli, "voxelize", str(mesh), "--resolution", "21", "--result", kind, "--layout", layout]
    subprocess.run([*command, *arguments, "-o", str(theirs)], check=True, capture_output=True)
    inside = voxelpipe.voxelize(mesh, resolution=21, result=kind, layout=layout, targets=targets)
    served = voxelpipe.voxelize(
        mesh, resolution=21, result=kind, layout=layout, targets=targets, packed_bits=True, server=server.server
    )
    inside.save(out / f"inside{extension}")
    served.save(str(out / f"served{extension.upper()}"))
    expected = contents(theirs)
    assert expected and all(expected.values())
    assert contents(out / f"inside{extension}") == expected
    assert contents(out / f"served{extension.upper()}") == expected
    assert len(list(out.iterdir())) == 3


@pytest.mark.parametrize("layout", ["interleaved", "planar"])
@pytest.mark.parametrize("target", ["bit:or", "f32x3:replace:shader=normal", "u8:max", COLOR])
@pytest.mark.parametrize("extension", [".npy", ".raw"])
def test_arrays_written_by_numpy_are_those_of_the_command_line(
    cli: str, mesh: pathlib.Path, out: pathlib.Path, extension: str, target: str, layout: Any
) -> None:
    theirs, ours = out / "theirs", out / "ours"
    ours.mkdir()
    command = [cli, "voxelize", str(mesh), "--resolution", "21", "--target", target, "--layout", layout]
    subprocess.run([*command, "-o", str(theirs / f"a{extension}")], check=True, capture_output=True)
    voxelpipe.voxelize(mesh, resolution=21, targets=[target], layout=layout).save(ours / f"a{extension}")
    assert contents(ours) == contents(theirs)  # with the description of a .raw
    compared = [cli, "compare", str(ours / f"a{extension}"), str(theirs / f"a{extension}")]
    assert subprocess.run(compared, capture_output=True).returncode == 0


def test_changed_arrays_and_pickles_are_written_as_they_are(mesh: pathlib.Path, out: pathlib.Path) -> None:
    grid = voxelpipe.voxelize(mesh, resolution=13, mask="bit", result="dense")
    grid.mask[:] = numpy.random.default_rng(1).random(grid.mask.shape) < 0.5
    pickle.loads(pickle.dumps(grid)).save(out / "a.nrrd")
    _, _, packed = (out / "a.nrrd").read_bytes().partition(b"\n\n")
    voxels = numpy.frombuffer(gzip.decompress(packed), numpy.uint8).reshape(grid.mask.shape)
    assert numpy.array_equal(voxels, grid.mask)


def test_a_format_refuses_what_it_cannot_hold(mesh: pathlib.Path, out: pathlib.Path) -> None:
    several = voxelpipe.voxelize(mesh, resolution=8, targets=SEVERAL)
    said = r"\.nrrd holds one target; 4 targets go into .*\.zarr"
    with pytest.raises(voxelpipe.InvalidRequest, match=said) as caught:
        several.save(out / "a.nrrd")
    assert isinstance(caught.value, ValueError) and caught.value.field == "path"
    buckets = voxelpipe.voxelize(mesh, resolution=8, result="buckets")
    with pytest.raises(ValueError, match=r"\.vti holds dense results; a buckets one goes into"):
        buckets.save(out / "a.vti")
    for name in ("a.txt", "a.gz"):
        with pytest.raises(ValueError, match=r"out/a.*': no writer for '.*'; known extensions are \.npy, .*\.vti"):
            buckets.save(out / name)
    for name in ("a", ".vti"):
        with pytest.raises(ValueError, match=r"has no extension; expected one of \.npy, .*\.vti"):
            buckets.save(out / name)
    assert not list(out.iterdir())


def test_arrays_of_wrong_sizes_are_refused(grid: VoxelGrid, out: pathlib.Path) -> None:
    grid.stored["target0"] = grid.stored["target0"][1:]
    with pytest.raises(voxelpipe.InvalidRequest, match="target0 is no flat buffer of 6912 bytes"):
        grid.save(out / "a.vti")
    grid.stored["target0"] = numpy.zeros((12, 12, 24, 4), numpy.uint8)[:, :, ::2]
    grid.save(out / "a.vti")  # reshape made it flat
    with pytest.raises(core_module.core.Failed):
        core_module.core.write(grid._request, grid._header, [], b"a.vti")
    with pytest.raises(core_module.core.Failed):
        core_module.core.write(grid._request, grid._header, [numpy.zeros(2 * 6912, numpy.uint8)[::2]], b"a.vti")
    with pytest.raises(core_module.core.Failed):
        core_module.core.write(b"\xff", grid._header, [], b"a.vti")
    assert [path.name for path in out.iterdir()] == ["a.vti"]


def test_without_the_core_the_package_is_named(
    grid: VoxelGrid, out: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(core_module, "_looked", True)
    monkeypatch.setattr(core_module, "core", None)
    for extension in {one["extension"] for one in FORMATS} - {*save._OWN}:
        with pytest.raises(voxelpipe.MissingPackage, match="none of .npy, .npz, .raw, .png; every other") as caught:
            grid.save(out / f"a{extension}")
        assert extension in str(caught.value) and caught.value.package == "voxelpipe_core"
        assert "needs the package voxelpipe-core, which is not installed" in str(caught.value)
    with pytest.raises(ValueError, match="expected one of .npy, .npz, .raw, .png$"):
        grid.save(out / "a")
    for extension in save._OWN:
        grid.save(out / f"a{extension}")
    assert len(list(out.iterdir())) == 5
    monkeypatch.setattr(core_module, "_forked_after_use", True)
    with pytest.raises(voxelpipe.MissingPackage, match="was used before this process was forked"):
        grid.save(out / "a.vti")


def test_what_is_not_kept_is_warned_of(cli: str, mesh: pathlib.Path, out: pathlib.Path, grid: VoxelGrid) -> None:
    said = ".vox: the file shows the solid voxels in one colour each, not every target"
    normal = "f16x3:replace:shader=normal"
    two = voxelpipe.voxelize(mesh, resolution=12, targets=[COLOR, normal])
    with pytest.warns(UserWarning, match=f"not_kept: {said}") as caught:
        two.save(out / "a.vox")
    assert len(caught) == 1 and caught[0].filename == __file__
    command = [cli, "voxelize", str(mesh), "--resolution", "12", "--target", COLOR, "--target", normal, "-o"]
    ran = subprocess.run([*command, str(out / "cli.vox")], check=True, capture_output=True, text=True)
    assert said in ran.stderr
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        grid.save(out / "a.glb")
        with pytest.raises(UserWarning, match=said):
            two.save(out / "b.vox")
    strict = voxelpipe.voxelize(mesh, resolution=12, targets=[COLOR, normal], strict=True)
    with pytest.raises(voxelpipe.InvalidRequest, match=said):
        strict.save(out / "c.vox")
    assert subprocess.run([*command, str(out / "d.vox"), "--strict"], capture_output=True).returncode != 0
    strict.save(out / "c.ply")
    assert sorted(path.name for path in out.iterdir()) == ["a.glb", "a.vox", "c.ply", "cli.vox"]


def test_a_format_that_never_holds_a_place_does_not_fail_a_strict_request(
    cli: str, mesh: pathlib.Path, out: pathlib.Path
) -> None:
    strict = voxelpipe.voxelize(mesh, resolution=12, targets=[COLOR], strict=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        strict.save(out / "a.vox")
    command = [cli, "voxelize", str(mesh), "--resolution", "12", "--strict", "-o", str(out / "b.vox")]
    assert subprocess.run(command, capture_output=True, text=True).returncode == 0


@pytest.mark.parametrize("name", ["dims", "origin", "voxel_size", "index_to_world", "ijk", "offsets", "triangle"])
def test_a_target_does_not_replace_another_array_of_an_npz(mesh: pathlib.Path, out: pathlib.Path, name: str) -> None:
    target = voxelpipe.Target(name=name, format="u8")
    with pytest.raises(ValueError, match=f"the target '{name}' has the name of another array"):
        voxelpipe.voxelize(mesh, resolution=12, result="sparse", targets=[target]).save(out / "a.npz")
    assert not list(out.iterdir())


def test_a_target_of_any_other_name_is_in_an_npz(mesh: pathlib.Path, out: pathlib.Path) -> None:
    targets = [voxelpipe.Target(name=name, format="u8") for name in ("file", "allow_pickle", "args")]
    grid = voxelpipe.voxelize(mesh, resolution=12, targets=targets)
    grid.save(out / "a.npz")
    with numpy.load(out / "a.npz") as arrays:
        for target in targets:
            assert numpy.array_equal(arrays[target.name], grid[target.name])


@pytest.mark.parametrize("extension", [".vti", ".zarr", ".ply"])
def test_a_path_that_cannot_be_written_is_an_os_error(grid: VoxelGrid, out: pathlib.Path, extension: str) -> None:
    with pytest.raises(FileNotFoundError, match="No such file"):
        grid.save(out / "none" / f"a{extension}")
    taken = out / f"a{extension}"
    taken.mkdir()
    (taken / "kept").write_bytes(b"1")
    with pytest.raises((IsADirectoryError, FileExistsError), match="a.(vti|zarr|ply)"):
        grid.save(taken)
    assert contents(taken) == {"kept": b"1"} and list(out.iterdir()) == [taken]


def test_a_full_device_is_an_os_error(grid: VoxelGrid, out: pathlib.Path) -> None:
    (out / "a.vti").symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left"):
        grid.save(out / "a.vti")


def test_other_threads_run_while_a_file_is_written(grid: VoxelGrid, out: pathlib.Path) -> None:
    grid.save(out / "file.ply")
    os.mkfifo(out / "pipe.ply")
    saver = threading.Thread(target=lambda: grid.save(out / "pipe.ply"))
    saver.start()  # waits for a reader, which is this thread
    read = (out / "pipe.ply").read_bytes()
    saver.join()
    assert read == (out / "file.ply").read_bytes()


def test_ctrl_c_leaves_no_file(mesh: pathlib.Path, out: pathlib.Path) -> None:
    grid = voxelpipe.voxelize(mesh, resolution=256, targets="u32:replace:shader=triangle_id")
    stored = grid.stored["target0"]
    stored[:] = numpy.random.default_rng(1).integers(0, 1 << 32, stored.shape, numpy.uint32)  # slow to compress

    def interrupt() -> None:
        while not any(".part-" in path.name for path in out.iterdir()):
            time.sleep(0.001)
        os.kill(os.getpid(), signal.SIGINT)

    for extension in (".nrrd", ".zarr"):
        watcher = threading.Thread(target=interrupt)
        watcher.start()
        with pytest.raises(KeyboardInterrupt):
            grid.save(out / f"a{extension}")
        watcher.join()
        assert not list(out.iterdir())


@pytest.fixture()
def opened(monkeypatch: pytest.MonkeyPatch, out: pathlib.Path) -> list[str]:
    """The addresses of pages that were opened in a browser; files of pages are in `out`."""
    addresses: list[str] = []
    monkeypatch.setattr(webbrowser, "open", addresses.append)
    monkeypatch.setattr("tempfile.tempdir", str(out))
    return addresses


def test_show_opens_the_viewer(
    mesh: pathlib.Path, grid: VoxelGrid, out: pathlib.Path, tmp_path: pathlib.Path, opened: list[str]
) -> None:
    if ".html" not in {one["extension"] for one in FORMATS}:
        pytest.skip("this build has no viewer")
    sparse = voxelpipe.voxelize(mesh, resolution=12, result="sparse")
    for number, shown in enumerate([grid, sparse]):
        shown.show()
        shown.save(tmp_path / "a.html")
        assert pathlib.Path(opened[number].removeprefix("file://")).read_bytes() == (tmp_path / "a.html").read_bytes()
    assert len(opened) == len(list(out.iterdir())) == 2


@pytest.mark.parametrize("case", ["buckets", "no core", "no viewer"])
def test_show_opens_the_table_without_a_viewer(
    mesh: pathlib.Path, opened: list[str], monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    grid = voxelpipe.voxelize(mesh, resolution=12, result="buckets" if case == "buckets" else "dense")
    if case == "no core":
        monkeypatch.setattr(core_module, "core", None)
    elif case == "no viewer":
        fewer = [one for one in FORMATS if one["extension"] != ".html"]
        monkeypatch.setattr(core_module.core, "formats", lambda: fewer)
    grid.show()
    page = pathlib.Path(opened[0].removeprefix("file://")).read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>") and grid._repr_html_() in page


def test_a_viewer_that_fails_leaves_no_page(
    grid: VoxelGrid, out: pathlib.Path, opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if ".html" not in {one["extension"] for one in FORMATS}:
        pytest.skip("this build has no viewer")
    grid.stored["target0"] = grid.stored["target0"][1:]
    with pytest.raises(voxelpipe.InvalidRequest):
        grid.show()
    assert not opened and not list(out.iterdir())

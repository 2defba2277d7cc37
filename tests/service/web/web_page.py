"""usage: web_page.py PROGRAMS_DIR SOURCE_DIR WORK_DIR

Tests the page's modules alone (page_errors.mjs, page_mesh.mjs, page_options.mjs), then uses the server's page in a
headless Chromium. The mesh must be sent once, and a run must make one call, also by the server's own counts. What the
page downloads must be the bytes that the command line writes for the same request. Exit 77 with the reason if Chromium
(docker/packages-browser.txt) or npm's packages are missing.
"""
import json
import pathlib
import re
import shutil
import subprocess
import sys
import zipfile

PROGRAMS, SOURCE, WORK = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
sys.path.insert(0, str(SOURCE / "tests/support"))
import npm_packages  # noqa: E402

BROWSERS = ("chromium-headless-shell", "chromium")
TOKEN = "token-of-the-page-0123456789"
# The server's own count of runs after the picture of the example, that of two changed options, and two files of the
# latter (drive_example.mjs): the server keeps the result of the picture, of which the files are made too.
RUNS = [1, 2, 2, 2]
REQUEST = ["--resolution", "48", "--fill", "parity", "--target", "bit:or", "--target", "f32:average:shader=normal"]


class Server:
    def __init__(self, *options):
        command = [PROGRAMS / "voxelpiped", "--listen", "127.0.0.1:0", "--web-listen", "127.0.0.1:0",
                   "--http-listen", "127.0.0.1:0", *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        for line in self.process.stdout:
            found = re.match(r"(http|web) on (?:http://)?(\S+)", line)
            if found and found.group(1) == "http":
                self.metrics = f"http://{found.group(2)}/metrics"
            elif found:
                self.url = f"http://{found.group(2)}/"
                return
        raise AssertionError("the server does not say where its page is")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        assert self.process.wait(30) == 0, "the server did not end well"


def drive(name, modules, browser, url, what, folder, *token):
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    script = SOURCE / f"tests/service/web/{name}.mjs"
    command = ["node", str(script), str(modules), browser, url, str(what), str(folder), *token]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def check(seen, mesh, folder):
    assert seen["problems"] == [] and seen["foreign"] == [], seen
    assert seen["state"] == "done" and seen["error"] == "", seen
    assert re.match(r"\d+ triangles; \d+ x \d+ x \d+ voxels, ", seen["plan"]), seen["plan"]
    assert re.match(r"[1-9]\d* occupied voxels of [1-9]\d* triangles", seen["summary"]), seen["summary"]
    assert seen["calls"] == ["CreateMesh", "file"], seen["calls"]
    assert not seen["too_wide"], "a phone has to scroll sideways"
    if seen["focus"]:
        fields = ("file", "example", "resolution", "coverage", "fill", "add", "run")
        order = [seen["focus"].index(name) for name in fields]
        assert order == sorted(order), seen["focus"]
    assert seen["after_cancel"] == "cancelled", seen["after_cancel"]
    same = []
    for name, error in seen["files"].items():
        if error:
            assert re.search(r"holds one target", error), (name, error)
            continue
        own = folder / "own" / f"result.{name}"
        command = [PROGRAMS / "voxelpipe", "voxelize", mesh, *REQUEST, "-o", own]
        subprocess.run(command, check=True, capture_output=True)
        got = folder / f"{mesh.stem}.{name}"
        if got.is_file():
            assert got.read_bytes() == own.read_bytes(), f".{name}: other bytes"
        else:  # several files
            with zipfile.ZipFile(folder / f"{mesh.stem}.{name}.zip") as archive:
                written = {path.relative_to(own.parent).as_posix(): path.read_bytes()
                           for path in own.parent.rglob("*") if path.is_file()}
                packed = {entry: archive.read(entry) for entry in archive.namelist()}
                assert packed == written, f".{name}: {sorted(packed)}, not {sorted(written)}"
        shutil.rmtree(own.parent)
        same.append(name)
    print(f"the same bytes as the command line's: {' '.join(same)}")
    assert {"npy", "npz", "raw", "vti", "zarr", "ply", "glb", "vox", "binvox"} <= set(same), same
    assert seen["fills_of_parts"] == ["FILL_NONE", "FILL_PARITY", "FILL_NONZERO"], seen["fills_of_parts"]
    assert seen["state_of_parts"] == "done", seen
    if "html" in seen["files"]:
        assert int(seen["faces"]) > 1000, "no voxels are shown"
        (part,) = seen["parts"]
        assert re.match(r"1( .*)?: [\d,]+ triangles, [\d,]+ voxels$", part), part


def check_example(seen, folder):
    assert seen["problems"] == [], seen
    assert all(all(sights.values()) for sights in seen["in_sight"].values()), seen["in_sight"]
    assert not any(seen["too_wide"].values()), seen["too_wide"]
    assert seen["run_calls"] == ["CreateMesh", "file", "file", "file", "file"], seen["calls"]
    mesh = folder / "mesh/knot.glb"
    assert seen["mesh_bytes"] == mesh.stat().st_size, "the mesh was sent more than once"
    assert seen["runs"] == RUNS, f"{seen['runs']} runs, not {RUNS}"
    colours, shape, named = seen["shown"]
    assert "colours of the mesh" in colours and "shape alone" in shape and "base_color" in named, seen["shown"]
    assert seen["coloured_by"] in ("target0: u8x4 base_color", None), seen["coloured_by"]
    assert "last run" in seen["stale"] and seen["stale_after"] == "", seen
    assert seen["fills"] == ["FILL_PARITY", "FILL_NONZERO"] and seen["fill"] == "FILL_PARITY", seen
    assert seen["targets"] == ["base_color U8 SRGB REPLACE", "normal F32 LINEAR AVERAGE"], seen["targets"]
    assert seen["targets_left"] == 0 and seen["focus_after_removal"] == "add", seen
    field, why = seen["wrong"]
    assert field == "size" and seen["error"].endswith(why), seen
    assert " of 1 triangles " in seen["dropped"], "a dropped mesh is not voxelized"
    for name in ("glb", "vox"):
        own = folder / "own" / f"result.{name}"
        command = [PROGRAMS / "voxelpipe", "voxelize", mesh, "--resolution", "48", "--fill", "parity", "-o", own]
        subprocess.run(command, check=True, capture_output=True)
        assert (folder / f"knot.{name}").read_bytes() == own.read_bytes(), f".{name}: other bytes"


def main():
    WORK.mkdir(parents=True, exist_ok=True)
    if shutil.which("node"):
        for name in ("page_errors", "page_mesh", "page_options"):
            script = SOURCE / f"tests/service/web/{name}.mjs"
            subprocess.run(["node", script, SOURCE / "server/web/page", WORK / name], check=True)
    browser = next((found for found in map(shutil.which, BROWSERS) if found), None)
    modules, missing = (None, f"none of {', '.join(BROWSERS)} is installed")
    if browser:
        modules, missing = npm_packages.install(SOURCE / "tests/formats", WORK / "npm")
    if missing:
        print(f"skipped: {missing}")
        return 77
    mesh = WORK / "ball.glb"
    subprocess.run([sys.executable, SOURCE / "tests/support/make_ball.py", mesh], check=True)
    with Server() as server:
        seen = drive("drive_page", modules, browser, server.url, mesh, WORK / "open")
        assert seen["focus"], "no key reaches a field"
        check(seen, mesh, WORK / "open")
    with Server() as server:
        seen = drive("drive_example", modules, browser, server.url, server.metrics, WORK / "example")
        check_example(seen, WORK / "example")
    tokens = WORK / "tokens.json"
    tokens.write_text(json.dumps({"clients": [{"name": "page", "token": TOKEN, "role": "user"}]}))
    tokens.chmod(0o600)
    with Server("--token-file", str(tokens)) as server:
        seen = drive("drive_page", modules, browser, server.url, mesh, WORK / "token", TOKEN)
        assert seen["without_token"].startswith("a token is needed") and seen["token_focused"], seen
        assert seen["wrong_token"] == "the token is unknown", seen
        check(seen, mesh, WORK / "token")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""usage: readers.py VOXELPIPE SOURCE_DIR WORK_DIR

Writes small results in every format and compares what software of others reads - cells, values and world positions -
with the .npz of the same request. Debian's readers are those of docker/packages-formats.txt and
docker/packages-python-extras.txt, npm's those of package.json; without one, its rows are skipped and named. Exit 77 if
none was there. VOXELPIPE_THOROUGH_TESTS=1: also files beyond 4 GiB.
"""
import gzip
import importlib
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import numpy as np

VOXELPIPE, SOURCE, WORK = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
sys.path.insert(0, str(SOURCE / "tests/support"))
import glb  # noqa: E402
import npm_packages  # noqa: E402

L = np.array([[1, 1, 1], [1, 1, 2], [2, 1, 1]])
BITS = ["--target", "bit:or"]
U16X3 = ["--target", "u16x3:max:shader=position,scale=100"]
COLOURS = [*BITS, "--target", "u8x3:replace:shader=barycentric"]


class Missing(Exception):
    """A reader is not installed."""


def need_module(name):
    try:
        return importlib.import_module(name)
    except ImportError:
        raise Missing(f"Python has no module {name}") from None


def need_program(name):
    if shutil.which(name) is None:
        raise Missing(f"{name} is not installed")
    return name


def need_npm():
    """The folder with npm's packages, installed on first use."""
    modules, missing = npm_packages.install(SOURCE / "tests/formats", WORK / "npm")
    if missing:
        raise Missing(missing)
    return modules


def read_models(path):
    script = SOURCE / "tests/formats/read_models.mjs"
    command = ["node", str(script), str(need_npm()), str(path)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


class Case:
    """A request: triangles around the centres of `cells` in a grid of its own."""

    def __init__(self, name, dims, cells, origin=(10, 20, 30), size=(0.1, 0.2, 0.4)):
        self.name, self.dims, self.cells = name, dims, np.array(cells).reshape(-1, 3)
        self.origin, self.size = np.array(origin, float), np.array(size, float)
        self.mesh = WORK / f"{name}.glb"
        corners = np.array([[-0.2, -0.1, 0.1], [0.2, -0.2, 0], [0, 0.2, -0.1]])
        at = self.cells if len(self.cells) else np.array([[-9, -9, -9]])  # outside
        points = self.origin + ((at[:, None] + 0.5) + corners) * self.size
        glb.write_glb(self.mesh, points.reshape(-1, 3), np.arange(3 * len(at)).reshape(-1, 3))

    def write(self, name, targets, *options):
        out = WORK / f"{self.name}.{name}"
        numbers = [",".join(repr(float(n)) for n in values) for values in (self.origin, self.size)]
        command = [str(VOXELPIPE), "voxelize", str(self.mesh), "--dims", ",".join(map(str, self.dims)),
                   f"--origin={numbers[0]}", "--voxel-size", numbers[1], "-o", str(out), *targets, *options]
        subprocess.run(command, check=True, capture_output=True, text=True)
        return out


def components(array):
    return 1 if array.ndim == 3 else array.shape[-1]


class Expected:
    """The reference: the .npz of the same request, read by NumPy."""

    def __init__(self, case, targets):
        with np.load(case.write("npz", targets)) as archive:
            self.arrays = [archive[f"target{i}"] for i in range(sum(t == "--target" for t in targets))]
            to_world = archive["index_to_world"]
        first = self.arrays[0]
        mask = first != 0 if first.ndim == 3 else np.any(first != 0, axis=-1)
        self.cells = np.argwhere(mask)[:, ::-1]
        assert sorted(map(tuple, self.cells)) == sorted(map(tuple, case.cells)), "the mesh does not cover its cells"
        self.world = self.cells @ to_world[:3, :3].T + to_world[:3, 3]
        self.values = [array[mask].reshape(len(self.cells), components(array)) for array in self.arrays]

    def check(self, cells, world, *values):
        cells = np.asarray(cells, np.int64).reshape(-1, 3)
        order, own = np.lexsort(cells.T), np.lexsort(self.cells.T)
        assert np.array_equal(cells[order], self.cells[own]), "other cells"
        if world is not None and len(cells):
            assert np.allclose(np.asarray(world)[order], self.world[own], rtol=1e-6, atol=0), "other positions"
        for value, expected in zip(values, self.values):
            value = np.asarray(value).reshape(len(cells), expected.shape[-1])
            assert np.array_equal(value[order], expected[own]), "other values"


def check_grid(expected, array, centre):
    """In: array (nz, ny, nx, c); centre(cells): world positions of the centres of cells (n, 3)."""
    mask = np.any(array != 0, axis=-1)
    cells = np.argwhere(mask)[:, ::-1]
    expected.check(cells, centre(cells), array[mask])


def vtk_image(path, reader_name):
    vtk = need_module("vtk")
    numpy_support = importlib.import_module("vtk.util.numpy_support")
    reader = getattr(vtk, reader_name)()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput(), numpy_support.vtk_to_numpy


def vti(case):
    for targets in (BITS, U16X3):
        expected = Expected(case, targets)
        image, to_numpy = vtk_image(case.write("vti", targets), "vtkXMLImageDataReader")
        nx, ny, nz = (n - 1 for n in image.GetDimensions())
        array = to_numpy(image.GetCellData().GetArray("target0")).reshape(nz, ny, nx, -1)

        def centre(cells):
            bounds = [image.GetCell(int(i + nx * (j + ny * k))).GetBounds() for i, j, k in cells]
            return np.array([[(b[0] + b[1]) / 2, (b[2] + b[3]) / 2, (b[4] + b[5]) / 2] for b in bounds])

        check_grid(expected, array, centre)


def nrrd(case):
    unu = need_program("teem-unu")
    for targets in (BITS, U16X3):
        expected = Expected(case, targets)
        path = case.write("nrrd", targets)
        head = subprocess.run([unu, "head", str(path)], check=True, capture_output=True, text=True).stdout
        fields = dict(re.findall(r"^([a-z ]+): (.*)$", head, re.M))
        sizes = [int(n) for n in fields["sizes"].split()]
        kind = {"uint8": "u1", "uint16": "<u2"}[fields["type"]]
        data = subprocess.run([unu, "data", str(path)], check=True, capture_output=True).stdout
        raw = gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data
        array = np.frombuffer(raw, kind).reshape(*sizes[::-1][:3], -1)
        vectors = [np.array(v.split(","), float) for v in re.findall(r"\(([^)]*)\)", fields["space directions"])]
        origin = np.array(fields["space origin"].strip("()").split(","), float)
        check_grid(expected, array, lambda cells: origin + cells @ np.array(vectors))


def nifti(case):
    nibabel = need_module("nibabel")
    for targets in (BITS, U16X3):
        expected = Expected(case, targets)
        image = nibabel.load(str(case.write("nii.gz", targets)))
        data = np.asarray(image.dataobj)
        array = np.moveaxis(data.reshape(*data.shape[:3], -1), (0, 1, 2), (2, 1, 0))
        check_grid(expected, array, lambda cells: cells @ image.affine[:3, :3].T + image.affine[:3, 3])


def zarr(case):
    module = need_module("zarr")
    for targets in (BITS, U16X3):
        expected = Expected(case, targets)
        group = module.open_group(str(case.write("zarr", targets)), mode="r")
        for level, dataset in enumerate(group.attrs["multiscales"][0]["datasets"]):
            data = group[dataset["path"]][:]
            array = np.moveaxis(data, 0, -1) if data.ndim == 4 else data[..., None]
            scale, shift = (np.array(t[t["type"]][-3:][::-1]) for t in dataset["coordinateTransformations"])
            if level == 0:
                check_grid(expected, array, lambda cells: cells * scale + shift)
                continue
            # Each cell lies in one of the level's that is as much larger.
            large = np.unique(expected.cells >> level, axis=0)
            assert np.array_equal(np.unique(np.argwhere(array.any(-1))[:, ::-1], axis=0), large), level
            inside = np.abs(expected.world - ((expected.cells >> level) * scale + shift)) < scale / 2
            assert inside.all(), level


def ply_meshio(case):
    meshio = need_module("meshio")
    for targets in (BITS, U16X3, COLOURS):
        expected = Expected(case, targets)
        mesh = meshio.read(case.write("ply", targets))
        data = mesh.point_data
        cells = np.stack([data[a] for a in "ijk"], -1)
        names = [f"target{i}" if array.ndim == 3 else [f"target{i}_{c}" for c in range(array.shape[-1])]
                 for i, array in enumerate(expected.arrays)]
        values = [data[n] if isinstance(n, str) else np.stack([data[m] for m in n], -1) for n in names]
        expected.check(cells, mesh.points, *values)


def ply_open3d(case):
    open3d = need_module("open3d")
    if not len(case.cells):
        return  # Open3D refuses files without points
    expected = Expected(case, COLOURS)
    cloud = open3d.io.read_point_cloud(str(case.write("ply", COLOURS)))
    points = np.asarray(cloud.points)
    expected.check(np.floor((points - case.origin) / case.size), points)
    cells = np.rint((points - case.origin) / case.size - 0.5).astype(int)
    assert np.array_equal(np.rint(np.asarray(cloud.colors) * 255), srgb(expected, cells)), "other colours"


def srgb(expected, cells):
    """sRGB codes of the colours of cells: barycentric coordinates as linear RGB."""
    place = {tuple(cell): value for cell, value in zip(expected.cells, expected.values[1])}
    linear = np.array([place[tuple(cell)] for cell in cells]) / 255
    code = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.rint(code * 255)


def glb_three(case):
    check_surface(case, "surface.glb")


def merged_glb_three(case):
    check_surface(case, "surface.merged.glb")


def check_surface(case, name):
    """The rectangles of a .glb cover each exposed face once, in its voxel's colour; only merged ones are larger."""
    for targets in (BITS, COLOURS):
        expected = Expected(case, targets)
        model = read_models(case.write(name, targets))
        assert model["issues"]["numErrors"] == 0 and model["issues"]["numWarnings"] == 0, model["issues"]
        solid = {tuple(cell) for cell in expected.cells}
        faces = {(cell, axis, way) for cell in solid for axis in range(3) for way in (-1, 1)
                 if tuple(np.add(cell, way * np.eye(3, dtype=int)[axis])) not in solid}
        if not solid:
            assert not model["meshes"]
            continue
        (mesh,) = model["meshes"]
        index = (np.array(mesh["world"]) - case.origin) / case.size
        corners = np.rint(index)
        assert np.allclose(index, corners, atol=1e-4), "a vertex is no corner of a voxel"
        rectangles = np.array(mesh["indices"]).reshape(-1, 2, 3)  # two triangles each
        colours = np.array(mesh["colours"])
        if len(colours):
            assert len(np.unique(np.hstack([corners, colours]), axis=0)) == len(corners), "vertices are not shared"
        found = []
        for rectangle in rectangles:
            a, b, c = corners[rectangle[0]]
            normal = np.cross(b - a, c - a)
            axis = int(np.abs(normal).argmax())
            way = int(np.sign(normal[axis]))
            low, high = (getattr(corners[rectangle.ravel()], end)(0).astype(int) for end in ("min", "max"))
            low[axis] -= way > 0
            high[axis] = low[axis] + 1
            assert np.prod(high - low) == np.abs(normal).max(), "no rectangle"
            cells = [tuple(low + shift) for shift in np.ndindex(*(high - low))]
            found += [(cell, axis, way) for cell in cells]
            if len(colours):
                for cell in cells:
                    value = expected.values[1][np.all(expected.cells == cell, axis=1)][0]
                    assert np.allclose(colours[rectangle.ravel()] * 255, value, atol=0.01), "other colours"
        assert len(found) == len(faces) and set(found) == faces, "other faces"
        if "merged" not in name:
            assert len(rectangles) == len(faces)
        elif targets is BITS and len(faces) > 6:
            assert len(rectangles) < len(faces), "nothing was merged"


def vox(case):
    for targets in (BITS, COLOURS):
        expected = Expected(case, targets)
        model = read_models(case.write("vox", targets))
        read = model["read"]
        as_list = lambda chunk: chunk if isinstance(chunk, list) else [chunk]  # noqa: E731
        sizes, voxels = as_list(read["size"]), as_list(read["xyzi"])
        shifts = [frame["_t"] for node in as_list(read["ntrn"]) for frame in node["frames"] if "_t" in frame]
        shifts = [[int(n) for n in shift.split()] for shift in shifts]
        assert len(sizes) == len(voxels) == len(shifts) == len(model["models"]), "models"
        cells, colours, places = [], [], []
        for number, (size, shift) in enumerate(zip(sizes, shifts)):
            three = model["models"][number]
            assert [size["x"], size["y"], size["z"]] == [three["size"][a] for a in "xyz"]
            own = voxels[number]["values"]
            data = np.array(three["data"], int).reshape(-1, 4)
            assert np.array_equal(np.array([[v["x"], v["y"], v["z"], v["i"]] for v in own], int).reshape(-1, 4), data)
            centre = np.array([size["x"], size["y"], size["z"]]) // 2
            at = data[:, :3] + np.array(shift) - centre
            # The grid's centre is at 0: MagicaVoxel takes voxels from -1000 to 999.
            middle = np.array([case.dims[0], case.dims[2], case.dims[1]]) // 2
            cells += [[x, z, case.dims[2] - 1 - y] for x, y, z in at + middle]
            colours += [read["rgba"]["values"][i - 1] for i in data[:, 3]]
            places += list(at)
        expected.check(cells, None)
        if len(cells):
            # three's own scene has y up and z to the back, and centres models that have odd sizes half a voxel off.
            low, high = (np.array([box[e] for box in model["boxes"]]) for e in (0, 1))
            own = np.array(places)[:, [0, 2, 1]] * [1, 1, -1]
            assert np.all(np.abs(low.min(0) - (own.min(0) - [0, 0, 1])) <= 1), "three places it elsewhere"
            assert np.all(np.abs(high.max(0) - (own.max(0) + [1, 1, 0])) <= 1), "three places it elsewhere"
        if targets is COLOURS and len(cells):
            rgb = np.array([[c["r"], c["g"], c["b"]] for c in colours])
            assert np.array_equal(rgb, srgb(expected, cells)), "other colours"


def nvdb(case):
    need_program("nanovdb_validate")
    for targets in (BITS, U16X3):
        path = case.write("nvdb", targets)
        done = subprocess.run(["nanovdb_validate", str(path)], check=True, capture_output=True, text=True)
        assert "failed" not in (done.stdout + done.stderr).lower(), done.stdout
        listing = subprocess.run(["nanovdb_print", str(path)], check=True, capture_output=True, text=True).stdout
        assert "density" in listing, listing


def nvdb_values(case):
    need_program("nanovdb_convert")
    openvdb = need_module("pyopenvdb")
    if not len(case.cells):
        return
    for targets in (BITS, U16X3):
        vdb = WORK / f"{case.name}.nvdb.vdb"
        vdb.unlink(missing_ok=True)
        command = ["nanovdb_convert", "-f", str(case.write("nvdb", targets)), str(vdb)]
        subprocess.run(command, check=True, capture_output=True)
        check_openvdb(Expected(case, targets), openvdb.readAll(str(vdb))[0])


def vdb(case):
    openvdb = need_module("pyopenvdb")
    for targets in (BITS, U16X3):
        path = case.write("vdb", targets)
        first = path.read_bytes()
        assert case.write("vdb", targets).read_bytes() == first, "the same request has other bytes"
        grids = openvdb.readAll(str(path))[0]
        assert [grid.name for grid in grids] == ["density"] + ["target0"] * (targets is U16X3)
        assert grids[0].gridClass == "fog volume" and openvdb.read(str(path), "density").name == "density"
        check_openvdb(Expected(case, targets), grids)


def check_openvdb(expected, grids):
    for grid in grids:
        points = [item for item in grid.iterOnValues()]
        assert len(points) == grid.activeVoxelCount(), "tiles"
        cells = np.array([item.min for item in points])
        world = [grid.transform.indexToWorld(tuple(int(n) for n in cell)) for cell in cells]
        values = [item.value for item in points]
        if grid.name == "density":
            assert set(values) <= {1.0}
            expected.check(cells, world)
        else:
            expected.check(cells, world, values)


def binvox(case):
    """No reader of others is in Debian or npm: a second one, from the format's description."""
    cubic = Case(case.name + "-cubic", case.dims, case.cells, case.origin, (0.25, 0.25, 0.25))
    data = cubic.write("binvox", BITS).read_bytes()
    head, runs = data.split(b"\ndata\n", 1)
    fields = dict(line.split(b" ", 1) for line in head.split(b"\n"))
    side = int(fields[b"dim"].split()[0])
    assert fields[b"dim"].split() == [str(side).encode()] * 3 and fields[b"#binvox"] == b"1"
    pairs = np.frombuffer(runs, np.uint8).reshape(-1, 2)
    cube = np.repeat(pairs[:, 0], pairs[:, 1]).reshape(side, side, side)  # x, z, y
    cells = np.argwhere(cube)[:, [0, 2, 1]]
    world = np.array(fields[b"translate"].split(), float) + (cells + 0.5) * float(fields[b"scale"]) / side
    expected = Expected(cubic, BITS)
    expected.check(cells, world)


def beyond_4_gib(name):
    """A voxel in the last layer of a grid whose array has more than 2^32 bytes."""
    case = Case(f"large-{name}", (2048, 2048, 1100), [[2047, 2047, 1099], [1, 2, 3]])
    path = case.write(name, BITS)
    if name == "nii.gz":
        image = need_module("nibabel").load(str(path))
        assert image.shape == case.dims and image.dataobj[2047, 2047, 1099] == 1 and image.dataobj[1, 2, 3] == 1
    elif name == "zarr":
        array = need_module("zarr").open_group(str(path), mode="r")["0"]
        assert array.shape == case.dims[::-1] and array[1099, 2047, 2047] == 1 and array[3, 2, 1] == 1
    elif name == "vti":
        image, to_numpy = vtk_image(path, "vtkXMLImageDataReader")
        values = to_numpy(image.GetCellData().GetArray("target0"))
        assert len(values) == 2048 * 2048 * 1100
        assert values[-1] == 1 and values[1 + 2048 * (2 + 2048 * 3)] == 1 and np.count_nonzero(values) == 2
    elif name == "nrrd":
        for cell, value in (((2047, 2047, 1099), 1), ((1, 2, 3), 1), ((0, 0, 0), 0)):
            corner = [str(n) for n in cell]
            crop = [need_program("teem-unu"), "crop", "-i", str(path), "-min", *corner, "-max", *corner]
            cropped = subprocess.run(crop, check=True, capture_output=True).stdout
            data = subprocess.run(["teem-unu", "data", "-"], input=cropped, check=True, capture_output=True).stdout
            assert data == bytes([value]), (cell, data)
    elif name == "ply":
        points = need_module("meshio").read(path)
        cells = np.stack([points.point_data[a] for a in "ijk"], -1)
        assert sorted(map(tuple, cells)) == sorted(map(tuple, case.cells))
        assert np.allclose(points.points, case.origin + (cells + 0.5) * case.size)
    else:
        vdb = path
        if name == "nvdb":
            vdb = WORK / f"{case.name}.vdb"
            command = [need_program("nanovdb_convert"), "-f", str(path), str(vdb)]
            subprocess.run(command, check=True, capture_output=True)
        (grid,) = need_module("pyopenvdb").readAll(str(vdb))[0]
        cells = [item.min for item in grid.iterOnValues()]
        assert sorted(cells) == sorted(map(tuple, case.cells))
        world = [grid.transform.indexToWorld(cell) for cell in cells]
        assert np.allclose(world, case.origin + (np.array(cells) + 0.5) * case.size)
    shutil.rmtree(path) if path.is_dir() else path.unlink()


READERS = {"vti (VTK)": vti, "nrrd (teem)": nrrd, "nii.gz (nibabel)": nifti, "zarr (python3-zarr)": zarr,
           "ply (meshio)": ply_meshio, "ply (Open3D)": ply_open3d, "glb (gltf-validator, three)": glb_three,
           "merged.glb (gltf-validator, three)": merged_glb_three,
           "vox (vox-reader, three)": vox, "nvdb (nanovdb_validate)": nvdb,
           "nvdb (nanovdb_convert, OpenVDB)": nvdb_values, "vdb (OpenVDB)": vdb,
           "binvox (a second reader of our own)": binvox}


def make_cases():
    rng = np.random.default_rng(7)
    long = np.unique(rng.integers((0, 0, 0), (300, 17, 5), (200, 3)), axis=0)
    return [Case("L", (4, 5, 6), L), Case("long", (300, 17, 5), long), Case("empty", (4, 5, 6), [])]


def run(jobs, known):
    """Runs jobs (title, function, argument), those of formats that `known` names. Out: the exit status."""
    ran, failed = 0, 0
    for title, read, argument in jobs:
        name = title.split()[0]  # of the format
        if name in ("nvdb", "vdb", "h5") and not re.search(rf"\b{name}\b", known):
            print(f"skipped  {title}: this build does not write it")
            continue
        try:
            read(argument)
        except Missing as reason:
            print(f"skipped  {title}: {reason}")
            continue
        except (AssertionError, subprocess.CalledProcessError, KeyError, ValueError, TypeError, IndexError) as error:
            failed += 1
            print(f"FAILED   {title}: {type(error).__name__}: {error} {getattr(error, 'stderr', '') or ''}")
            continue
        ran += 1
        print(f"ok       {title}")
    print(f"{ran} read as they were written, {failed} not")
    return 1 if failed else 0 if ran else 77


def known_formats():
    return subprocess.run([str(VOXELPIPE), "voxelize", "--help"], capture_output=True, text=True).stdout


def main():
    WORK.mkdir(parents=True, exist_ok=True)
    jobs = [(f"{name}: {case.name}", read, case) for name, read in READERS.items() for case in make_cases()]
    if os.environ.get("VOXELPIPE_THOROUGH_TESTS") == "1":
        large = ("vti", "nrrd", "nii.gz", "zarr", "ply", "nvdb", "vdb")
        jobs += [(f"{name} beyond 4 GiB", beyond_4_gib, name) for name in large]
    return run(jobs, known_formats())


if __name__ == "__main__":
    sys.exit(main())

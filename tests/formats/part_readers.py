"""usage: part_readers.py VOXELPIPE SOURCE_DIR WORK_DIR

Writes assemblies of parts and labels in the formats that have room for their table, and compares what software of
others reads with the .npz of the same request, as readers.py does. Exit 77 if none was there.
"""
import json
import re
import subprocess
import sys

import numpy as np

from readers import (VOXELPIPE, WORK, Expected, check_grid, glb, known_formats, make_cases, need_module,
                     need_program, run, vtk_image)


def seg_nrrd(case):
    unu = need_program("teem-unu")
    labels = ["--target", "u16x1:max:shader=position,scale=100"]
    expected = Expected(case, labels)
    path = case.write("seg.nrrd", labels)
    fields, keys, array = read_nrrd(unu, path)
    vectors = [np.array(v.split(","), float) for v in re.findall(r"\(([^)]*)\)", fields["space directions"])]
    origin = np.array(fields["space origin"].strip("()").split(","), float)
    check_grid(expected, array, lambda cells: origin + cells @ np.array(vectors))
    found = np.unique(array[array != 0])
    check_segments(keys, array[..., 0], {int(label): f"label {label}" for label in found})


def read_nrrd(unu, path):
    """Fields, key/value pairs as teem reads them, and the voxels (nz, ny, nx, c)."""
    head = subprocess.run([unu, "head", str(path)], check=True, capture_output=True).stdout.decode()
    fields = dict(re.findall(r"^([a-z ]+): (.*)$", head, re.M))
    keys = dict(re.findall(r"^(\w+):=(.*)$", head, re.M))
    sizes = [int(n) for n in fields["sizes"].split()]
    kind = {"uint8": "u1", "uint16": "<u2", "uint32": "<u4"}[fields["type"]]
    # Through teem, which reads gzip and the text of the header by itself.
    copied = subprocess.run([unu, "save", "-f", "nrrd", "-e", "raw", "-i", str(path)], check=True,
                            capture_output=True).stdout
    data = copied[copied.index(b"\n\n") + 2:]
    return fields, keys, np.frombuffer(data, kind).reshape(*sizes[::-1][:3], -1)


def check_segments(keys, array, names):
    """The segments by the rules of 3D Slicer: a label each, its name, and the box of its voxels."""
    assert keys["Segmentation_SourceRepresentation"] == keys["Segmentation_MasterRepresentation"] == "Binary labelmap"
    assert "Binary labelmap" in keys["Segmentation_ContainedRepresentationNames"].split("|")
    count = sum(key.endswith("_ID") for key in keys)
    ids = [keys[f"Segment{n}_ID"] for n in range(count)]
    assert len(set(ids)) == count == len(names), ids
    for n in range(count):
        label = int(keys[f"Segment{n}_LabelValue"])
        assert keys[f"Segment{n}_Name"] == names[label], keys[f"Segment{n}_Name"]
        assert keys[f"Segment{n}_Layer"] == "0"
        colour = [float(c) for c in keys[f"Segment{n}_Color"].split()]
        assert len(colour) == 3 and min(colour) >= 0 and max(colour) <= 1
        k, j, i = np.nonzero(array == label)
        box = [bound(axis) for axis in (i, j, k) for bound in (np.min, np.max)] if len(i) else [0, -1] * 3
        assert [int(e) for e in keys[f"Segment{n}_Extent"].split()] == box, (label, box)


class Assembly:
    """Boxes that are parts, with hostile names; the .npz of it is the reference."""

    NAMES = ["body", "</Array>]]>&amp;<b>\"'", "line\nbreak := \\n", "Fl\u00fcgel", "boom"]
    LABELS = [3, 1, 3, 200, 7]  # two parts of one label
    TARGETS = ["--target", "u8:replace:shader=label", "--target", "u16x3:max:shader=position,scale=100"]

    def __init__(self):
        corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
        faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                 [0, 6, 4], [1, 5, 7], [1, 7, 3]]
        meshes = []
        for number, (name, label) in enumerate(zip(self.NAMES, self.LABELS)):
            glb.write_glb(WORK / f"part{number}.glb", corner * [2, 1, 3] + [1.5 * number, 0.5 * number, 0], faces)
            meshes.append({"input": f"part{number}.glb", "name": name, "label": label, "priority": number % 2})
        self.list = WORK / "parts.json"
        self.list.write_text(json.dumps({"meshes": meshes}), encoding="utf-8")
        with np.load(self.write("npz", self.TARGETS)) as archive:
            self.arrays = {name: archive[name] for name in archive.files}
        self.columns = {name: array for name, array in self.arrays.items()
                        if name.startswith("part_") and not name.startswith("part_name")}
        text, at = self.arrays["part_name"].tobytes(), self.arrays["part_name_offset"]
        self.names = [text[a:b].decode() for a, b in zip(at, at[1:])]
        assert sorted(self.columns["part_label"]) == sorted(self.LABELS) and "Fl\u00fcgel" in self.names

    def write(self, name, targets, out=None):
        out = out or WORK / f"parts.{name}"
        command = [str(VOXELPIPE), "voxelize", "--together", str(self.list), "--parts", "file", "--fill", "nonzero",
                   "--resolution", "24", "-o", str(out), *targets]
        subprocess.run(command, check=True, capture_output=True, text=True)
        return out

    def clean(self):
        """The names in formats whose texts have no control characters."""
        return [re.sub(r"[\x00-\x1f]", "?", name) for name in self.names]

    def check_columns(self, columns):
        assert set(columns) == set(self.columns), set(columns) ^ set(self.columns)
        for name, array in self.columns.items():
            assert np.array_equal(np.asarray(columns[name]), array), name


def parts_seg_nrrd(assembly):
    unu = need_program("teem-unu")
    for target in (assembly.TARGETS[:2], ["--target", "u32:replace:shader=label"], []):  # by default labels
        _, keys, array = read_nrrd(unu, assembly.write("seg.nrrd", target))
        assert np.array_equal(array[..., 0], assembly.arrays["target0"])
        names = {}
        for label, name in zip(assembly.columns["part_label"], assembly.clean()):
            # teem prints a text as it has it in a file, escaped.
            names.setdefault(int(label), name.replace("\\", "\\\\") or f"label {label}")
        check_segments(keys, array[..., 0], names)


def parts_vti(assembly):
    def read(path):
        image, to_numpy = vtk_image(path, "vtkXMLImageDataReader")
        fields = image.GetFieldData()
        arrays = [fields.GetAbstractArray(i) for i in range(fields.GetNumberOfArrays())]
        names = arrays.pop()
        assert names.GetName() == "part_name" and names.GetClassName() == "vtkStringArray"
        assert [names.GetValue(i) for i in range(names.GetNumberOfValues())] == assembly.clean()
        assembly.check_columns({array.GetName(): to_numpy(array) for array in arrays})
        for name in ("target0", "target1"):
            cells = to_numpy(image.GetCellData().GetArray(name)).reshape(assembly.arrays[name].shape)
            assert np.array_equal(cells, assembly.arrays[name]), name

    need_module("vtk")
    read(assembly.write("vti", assembly.TARGETS))
    with open(WORK / "parts-streamed.vti", "wb") as stream:
        command = [str(VOXELPIPE), "voxelize", "--together", str(assembly.list), "--parts", "file", "--fill",
                   "nonzero", "--resolution", "24", "-o", "-", "--format", "vti", *assembly.TARGETS]
        subprocess.run(command, check=True, stdout=stream, stderr=subprocess.DEVNULL)
    read(WORK / "parts-streamed.vti")


def parts_zarr(assembly):
    module = need_module("zarr")
    group = module.open_group(str(assembly.write("zarr", assembly.TARGETS)), mode="r")
    parts = dict(group.attrs["voxelpipe"]["parts"])
    assert parts.pop("name") == assembly.names
    assembly.check_columns({f"part_{name}": column for name, column in parts.items()})
    label = group["target0"].attrs["image-label"]
    assert [c["label-value"] for c in label["colors"]] == sorted(set(assembly.LABELS))
    assert "image-label" not in group["target1"].attrs
    assert np.array_equal(group["target0/0"][:], assembly.arrays["target0"])


def parts_raw(assembly):
    assembly.write("raw", assembly.TARGETS)
    parts = json.loads((WORK / "parts.raw.json").read_text(encoding="utf-8"))["parts"]
    assert parts.pop("name") == assembly.names
    assembly.check_columns({f"part_{name}": column for name, column in parts.items()})


def parts_h5(assembly):
    h5py = need_module("h5py")
    with h5py.File(assembly.write("h5", assembly.TARGETS[:2])) as file:
        check_h5_labels(file, assembly.arrays, assembly.arrays["target0"])
        parts = file["parts"]
        assert list(parts["name"].asstr()[:]) == assembly.clean()
        assembly.check_columns({f"part_{name}": parts[name][:] for name in parts if name != "name"})
    with h5py.File(assembly.write("h5", ["--target", "f32x1:max:shader=position"])) as file:
        data = file["data"]  # as Meep reads an epsilon_input_file
        assert data.dtype == np.float32 and data.shape == assembly.arrays["target0"].shape[::-1]
    most = ["--target", "u32:replace:shader=label", "--part-label"]
    with h5py.File(assembly.write("h5", [*most, "body=32768"])) as file:
        assert file["data"][:].max() == 32767
    try:
        assembly.write("h5", [*most, "body=32769"])
    except subprocess.CalledProcessError as refused:
        assert refused.returncode == 1 and "up to 32768; a voxel has 32769" in refused.stderr, refused.stderr
    else:
        raise AssertionError("a number of a material that 16 bits do not hold")


def check_h5_labels(file, arrays, labels):
    """What gprMax's #geometry_objects_read asks of a file: int16 (nx, ny, nz), -1 or a number from 0, and dx_dy_dz."""
    data = file["/data"]
    assert data.dtype == np.int16 and np.array_equal(data[:], labels.astype(np.int16).transpose() - 1)
    assert np.array_equal(file.attrs["dx_dy_dz"], arrays["voxel_size"])
    assert np.array_equal(file.attrs["origin"], arrays["origin"])


def h5(case):
    h5py = need_module("h5py")
    for target in (["--target", "u16x1:max:shader=position,scale=100"], ["--target", "bit:or"]):
        path = case.write("npz", target)
        with np.load(path) as archive, h5py.File(case.write("h5", target)) as file:
            check_h5_labels(file, archive, archive["target0"])
            assert "parts" not in file


READERS = {"h5 of parts (h5py)": parts_h5, "seg.nrrd of parts (teem)": parts_seg_nrrd, "vti of parts (VTK)": parts_vti,
           "zarr of parts (python3-zarr)": parts_zarr, "raw of parts (Python's json)": parts_raw}


def main():
    WORK.mkdir(parents=True, exist_ok=True)
    assembly = Assembly()
    jobs = [(name, read, assembly) for name, read in READERS.items()]
    for name, read in {"seg.nrrd (teem)": seg_nrrd, "h5 (h5py)": h5}.items():
        jobs += [(f"{name}: {case.name}", read, case) for case in make_cases()]
    return run(jobs, known_formats())


if __name__ == "__main__":
    sys.exit(main())

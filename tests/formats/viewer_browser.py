"""usage: viewer_browser.py VOXELPIPE SOURCE_DIR WORK_DIR

Opens .html results in a headless Chromium and compares them with the program's pictures and arrays. Exit 77 with the
reason if the format, Chromium (docker/packages-browser.txt) or npm's packages are missing.
"""
import json
import pathlib
import re
import shutil
import subprocess
import sys

import numpy as np

VOXELPIPE, SOURCE, WORK = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
sys.path.insert(0, str(SOURCE / "tests/support"))
sys.path.insert(0, str(SOURCE / "tests/formats"))
import glb  # noqa: E402
import npm_packages  # noqa: E402

BROWSERS = ("chromium-headless-shell", "chromium")
RED = ["--target", "f32x3:replace:shader=constant,value=1/0/0"]
BACKGROUND = np.array([233, 237, 241])
MIN_CONTRAST = 4.5  # of texts
MIN_OVERLAP = 0.98  # of the two silhouettes, intersection over union


# Three boxes of different lengths, low corner and size: no two views of them look alike.
BOXES = [([0, 0, 0], [4, 1, 1.5]), ([0, 1, 0], [1, 2, 0.8]), ([2.5, 0.2, 1.5], [0.7, 0.6, 2])]


def write_boxes(path, boxes=tuple(BOXES)):
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
                      [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])
    points = np.concatenate([corner * size + low for low, size in boxes])
    glb.write_glb(path, points, np.concatenate([faces + 8 * i for i in range(len(boxes))]))


def voxelize(mesh, name, *options):
    command = [str(VOXELPIPE), "voxelize", str(mesh), "-o", str(WORK / name), "--json", *options]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def drive(modules, browser, name):
    script = SOURCE / "tests/formats/drive_viewer.mjs"
    prefix = WORK / pathlib.Path(name).stem
    command = ["node", str(script), str(modules), browser, str(WORK / name), str(prefix)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert seen["problems"] == [] and seen["requests"] == [], seen
    assert seen["state"] == "ready" and seen["webgl"] == "2", seen
    assert len(seen["contrast"]) == 2 and min(seen["contrast"]) >= MIN_CONTRAST, seen["contrast"]
    dark = picture(WORK / f"{prefix.name}-dark.png")
    assert dark[5, 5].max() < 64 and dark[-5, -5].max() < 64, "the dark scheme has a light background"
    assert not seen["too_wide"], "a phone has to scroll sideways"
    print(f"{name}: {seen['faces']} faces, a frame in {seen['frame_ms'][0]:.0f} ms, "
          f"{seen['frame_ms'][1]:.0f} ms while it moves")
    return seen


def picture(path):
    from PIL import Image

    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def silhouette(image):
    """The largest red area, cut out and 400 x 400 pixels large."""
    from scipy import ndimage

    labels, count = ndimage.label(is_red(image))
    assert count > 0, "nothing red"
    largest = labels == 1 + np.argmax(ndimage.sum(labels > 0, labels, range(1, count + 1)))
    rows, columns = np.nonzero(largest.any(1))[0], np.nonzero(largest.any(0))[0]
    cut = largest[rows[0]:rows[-1] + 1, columns[0]:columns[-1] + 1]
    pick = [np.arange(400) * size // 400 for size in cut.shape]
    return cut[np.ix_(*pick)]


def is_red(image):
    return image[..., 0] > image[..., 1] + 40


def is_cut(image):
    """The colours of the inside: yellowish grey, which neither a red surface nor the bluish background is."""
    return (image[..., 0] - image[..., 1] < 20) & (image[..., 0] > image[..., 2])


def check_cuts(seen, prefix, mask=None):
    """What the cursor finds is what the picture shows, on the cuts of all six sides; and what `mask` has, if given."""
    from scipy import ndimage

    assert seen["legend"] == "" and len(seen["cuts"]) == 6, seen["legend"]
    for side, cut in enumerate(seen["cuts"]):
        image = picture(WORK / f"{prefix}-cut{side}.png")
        background = abs(image - BACKGROUND).sum(-1) < 30
        if mask is not None:
            shut = ndimage.binary_erosion(ndimage.binary_fill_holes(~background), iterations=4)
            assert not (shut & background).any(), f"side {side}: holes in the surface"
        agree, inside = 0, 0
        for x, y, text in cut["points"]:
            if not text:
                agree += background[y, x]
                continue
            is_inside = text.endswith(" · inside")
            inside += is_inside
            agree += is_cut(image[y, x]) if is_inside else not background[y, x] and not is_cut(image[y, x])
            if mask is None:
                continue
            cell = [int(n) for n in re.match(r"voxel (\d+), (\d+), (\d+) ", text).groups()]
            around = [np.array(cell) + way * np.eye(3, dtype=int)[axis] for axis in range(3) for way in (-1, 1)]
            padded = np.pad(mask, 1)
            solid = [padded[k + 1, j + 1, i + 1] for i, j, k in [cell, *around]]
            assert solid[0] and all(solid) == is_inside, f"side {side}: {text}"
            assert not is_inside or cell[side // 2] == cut["layer"], f"side {side}: {text} is not on the cut"
        assert inside >= 8 and "inside" in cut["legend"], f"side {side}: {inside} points inside, {cut['legend']}"
        assert agree >= 0.98 * len(cut["points"]), f"side {side}: {agree} of {len(cut['points'])} points agree"


def check_view(modules, browser):
    mesh = WORK / "boxes.glb"
    write_boxes(mesh)
    preview = WORK / "boxes-preview.png"
    options = ["--resolution", "96", "--fill", "parity", "--target", "bit:or", *RED]
    summary = voxelize(mesh, "boxes.html", *options, "--preview", str(preview), "--view", "30,20")
    voxelize(mesh, "boxes.npz", *options)
    seen = drive(modules, browser, "boxes.html")

    drawn = picture(preview)
    view = silhouette(drawn[:, :drawn.shape[1] * 3 // 4])  # the slices are at the right
    shown = silhouette(picture(WORK / "boxes-view.png"))
    overlap = (view & shown).sum() / (view | shown).sum()
    print(f"silhouettes overlap by {overlap:.4f}")
    assert overlap >= MIN_OVERLAP

    with np.load(WORK / "boxes.npz") as archive:
        mask = archive["target0"] != 0
    index, place = re.match(r"voxel (\d+, \d+, \d+) · at ([^·]+) · target1 1, 0, 0", seen["hover"]).groups()
    i, j, k = (int(n) for n in index.split(","))
    assert mask[k, j, i], "the cursor found an empty voxel"
    centre = np.array(summary["origin"]) + (np.array([i, j, k]) + 0.5) * np.array(summary["voxel_size"])
    assert np.allclose([float(n) for n in place.split(",")], centre, rtol=1e-5)
    assert seen["corner"] == "", "something is under a corner of the window"

    padded = np.pad(mask, 1)
    inner = padded[1:-1, 1:-1, 1:-1]
    faces = sum(int((inner & ~np.roll(padded, way, axis)[1:-1, 1:-1, 1:-1]).sum())
                for axis in range(3) for way in (-1, 1))
    assert int(seen["faces"]) == faces, (seen["faces"], faces)

    check_cuts(seen, "boxes", mask)

    def red(name):
        return int(is_red(picture(WORK / f"boxes-{name}.png")).sum())

    assert red("plain") == 0 and red("turned") == 0 < red("view"), "the colour was not changed"
    assert red("slice") < 0.9 * red("view"), "the slice hides nothing"
    assert (picture(WORK / "boxes-plain.png") != picture(WORK / "boxes-turned.png")).any(), "the keys turn nothing"


def check_parts(modules, browser):
    """The list of parts, with the colours that the voxels have, and their names under the cursor."""
    names = ["body", "</script><b>&amp; ]]>", "boom"]
    listed = []
    for number, (name, box) in enumerate(zip(names, BOXES)):
        write_boxes(WORK / f"box{number}.glb", [box])
        listed.append({"input": f"box{number}.glb", "name": name, "label": 3 - number})
    (WORK / "parts.json").write_text(json.dumps({"meshes": listed}), encoding="utf-8")
    command = [str(VOXELPIPE), "voxelize", "--together", str(WORK / "parts.json"), "--parts", "file", "--resolution",
               "64", "--fill", "nonzero", "--target", "u16:replace:shader=label", "-o", str(WORK / "parts.html")]
    subprocess.run(command, check=True, capture_output=True)
    seen = drive(modules, browser, "parts.html")
    texts = [text for text, _, _ in seen["labels"]]
    assert [text.split(":")[0] for text in texts] == ["1 boom", f"2 {names[1]}", "3 body"], texts
    assert all("12 triangles, " in text and text.endswith(" voxels") for text in texts), texts
    assert all(shown for _, shown, _ in seen["labels"]), "the colours are not beside the names"
    colours = [colour for _, _, colour in seen["labels"]]
    assert len(set(colours)) == 3
    match = re.search(r" · target0 (\d) \((.*)\)$", seen["hover"])
    assert match and names[3 - int(match[1])] == match[2], seen["hover"]
    # On the side that light meets in full, a colour is as it is in the list.
    image = picture(WORK / "parts-view.png")
    for colour in colours:
        rgb = np.array([int(colour[i:i + 2], 16) for i in (1, 3, 5)])
        assert (abs(image - rgb).sum(-1) < 12).sum() > 100, f"nothing is drawn in {colour}"


def check_large(modules, browser):
    ball = WORK / "ball.glb"
    command = [sys.executable, str(SOURCE / "tests/support/make_ball.py"), str(ball)]
    subprocess.run(command, check=True)
    voxelize(ball, "ball.html", "--resolution", "512", "--fill", "parity")
    seen = drive(modules, browser, "ball.html")
    assert 500_000 < int(seen["faces"]) <= 2_000_000 and "Shown at" not in seen["text"], seen["faces"]
    # Each second voxel of a solid, as those that hold `clear` are no part of a dense result: all six sides of each.
    checker = ["--fill", "parity", "--target", "u8:max:shader=checker,size=1", "--result", "dense"]
    voxelize(ball, "many.html", "--resolution", "160", *checker)
    seen = drive(modules, browser, "many.html")
    assert "Shown at 1/2 of the resolution" in seen["text"] and int(seen["faces"]) <= 2_000_000, seen["text"]
    check_cuts(seen, "many")
    # A grid without a solid voxel.
    voxelize(ball, "empty.html", "--dims", "4,4,4", "--origin", "99,99,99", "--voxel-size", "1")
    page = (WORK / "empty.html").read_text(encoding="utf-8")
    assert page.count("</script>") == 2, "the page has other scripts than its own"


def main():
    WORK.mkdir(parents=True, exist_ok=True)
    browser = next((found for found in map(shutil.which, BROWSERS) if found), None)
    known = subprocess.run([str(VOXELPIPE), "voxelize", "--help"], capture_output=True, text=True).stdout
    missing = "" if ".html" in known else "this build writes no .html"
    missing = missing or ("" if browser else f"none of {', '.join(BROWSERS)} is installed")
    modules, reason = (None, "") if missing else npm_packages.install(SOURCE / "tests/formats", WORK / "npm")
    try:
        import PIL  # noqa: F401
        import scipy  # noqa: F401
    except ImportError as error:
        missing = missing or str(error)
    if missing or reason:
        print(f"skipped: {missing or reason}")
        return 77
    check_view(modules, browser)
    check_parts(modules, browser)
    check_large(modules, browser)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""usage: xvfb-run -a reader_pictures.py VOXELPIPE SOURCE_DIR WORK_DIR SHEET.png

Draws a textured model as readers of its output formats show it, by the same camera, and puts the pictures on one sheet:
three.js (.glb, .vox) and the viewer (.html) in Chromium, VTK (.vti), Open3D (.ply), Blender's Cycles (.vdb, and .nvdb
converted by NanoVDB's tool). By hand: packages xvfb, blender, python3-pil, assimp-testmodels, those of
docker/packages-formats.txt, -python-extras.txt and -browser.txt. A picture without the model is an error.
"""
import math
import pathlib
import shutil
import subprocess
import sys

import numpy as np
from PIL import Image, ImageDraw

VOXELPIPE, SOURCE, WORK = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
sys.path.insert(0, str(SOURCE / "tests/support"))
import npm_packages  # noqa: E402

MODEL = "/usr/share/assimp/models/OBJ/spider.obj"
OPTIONS = ["--resolution", "192", "--target", "bit:or", "--target", "u8x3:average:shader=base_color,encoding=srgb"]
AZIMUTH, ELEVATION = 30, 20
SIZE, TILE = (640, 480), (320, 240)
BROWSER = next((found for found in map(shutil.which, ("chromium-headless-shell", "chromium")) if found), None)


def towards_camera():
    a, e = math.radians(AZIMUTH), math.radians(ELEVATION)
    return np.array([math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)])


def run(*command):
    subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)


def written(extension):
    path = WORK / f"model.{extension}"
    run(VOXELPIPE, "voxelize", MODEL, *OPTIONS, "-o", path)
    return path


def preview(out):
    path = WORK / "preview-and-slices.png"
    run(VOXELPIPE, "voxelize", MODEL, *OPTIONS, "-o", path, "--view", f"{AZIMUTH},{ELEVATION}")
    picture = Image.open(path)
    picture.crop((0, 0, picture.width * 3 // 4, picture.height)).save(out)  # the slices are at the right


def three(modules, extension, out):
    script = SOURCE / "tests/formats/draw_models.mjs"
    run("node", script, modules, BROWSER, out, written(extension), AZIMUTH, ELEVATION)


def viewer(modules, out):
    script, page = SOURCE / "tests/formats/viewer_picture.mjs", WORK / "page.png"
    run("node", script, modules, BROWSER, written("html"), page, f"{AZIMUTH},{ELEVATION}")
    picture = Image.open(page)
    picture.crop((0, 0, picture.width - 304, picture.height)).save(out)  # the controls are at the right


def vtk_cells(out):
    import vtk

    reader = vtk.vtkXMLImageDataReader()
    reader.SetFileName(str(written("vti")))
    solid = vtk.vtkThreshold()
    solid.SetInputConnection(reader.GetOutputPort())
    solid.SetInputArrayToProcess(0, 0, 0, vtk.vtkDataObject.FIELD_ASSOCIATION_CELLS, "target0")
    solid.SetThresholdFunction(vtk.vtkThreshold.THRESHOLD_UPPER)
    solid.SetUpperThreshold(1)
    faces = vtk.vtkGeometryFilter()
    faces.SetInputConnection(solid.GetOutputPort())
    faces.Update()
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputConnection(faces.GetOutputPort())
    mapper.SetScalarModeToUseCellFieldData()
    mapper.SelectColorArray("target1")
    mapper.SetColorModeToDirectScalars()
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    renderer = vtk.vtkRenderer()
    renderer.AddActor(actor)
    renderer.SetBackground(1, 1, 1)
    bounds = np.array(faces.GetOutput().GetBounds()).reshape(3, 2)
    centre, radius = bounds.mean(1), np.linalg.norm(bounds[:, 1] - bounds[:, 0]) / 2
    camera = renderer.GetActiveCamera()
    camera.SetViewUp(0, 1, 0)
    camera.SetViewAngle(30)
    camera.SetFocalPoint(*centre)
    camera.SetPosition(*(centre + 3 * radius * towards_camera()))
    renderer.ResetCameraClippingRange()
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.AddRenderer(renderer)
    window.SetSize(*SIZE)
    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    writer = vtk.vtkPNGWriter()
    writer.SetInputConnection(grab.GetOutputPort())
    writer.SetFileName(str(out))
    writer.Write()


def open3d_points(out):
    import open3d

    cloud = open3d.io.read_point_cloud(str(written("ply")))
    window = open3d.visualization.Visualizer()
    assert window.create_window(width=SIZE[0], height=SIZE[1], visible=False), "Open3D opens no window"
    window.add_geometry(cloud)
    window.get_render_option().point_size = 3
    control = window.get_view_control()
    control.set_lookat(cloud.get_axis_aligned_bounding_box().get_center())
    control.set_up([0, 1, 0])
    control.set_front(towards_camera())
    control.set_zoom(0.6)
    window.poll_events()
    window.update_renderer()
    window.capture_screen_image(str(out), True)
    window.destroy_window()


def blender(path, out):
    script = SOURCE / "tests/formats/blender_volume.py"
    run("blender", "-b", "--python-exit-code", 1, "--python", script, "--", path, "target1", out, AZIMUTH, ELEVATION)


def blender_of_nvdb(out):
    path = WORK / "from-nvdb.vdb"
    run("nanovdb_convert", "-f", written("nvdb"), path)
    blender(path, out)


def main():
    WORK.mkdir(parents=True, exist_ok=True)
    modules, missing = npm_packages.install(SOURCE / "tests/formats", WORK / "npm")
    assert not missing, missing
    tiles = {
        "--preview": preview,
        ".html, its viewer": lambda out: viewer(modules, out),
        ".glb, three.js": lambda out: three(modules, "glb", out),
        ".vox, three.js": lambda out: three(modules, "vox", out),
        ".vti, VTK": vtk_cells,
        ".ply, Open3D": open3d_points,
        ".vdb, Blender": lambda out: blender(written("vdb"), out),
        ".nvdb, converted, Blender": blender_of_nvdb,
    }
    sheet = Image.new("RGB", (4 * TILE[0], 2 * TILE[1]), "white")
    for n, (title, draw) in enumerate(tiles.items()):
        out = WORK / f"tile{n}.png"
        draw(out)
        picture = Image.open(out).convert("RGB")
        pixels = np.asarray(picture).astype(int)
        assert (pixels.max(2) < 140).mean() > 0.02, f"{title}: nothing dark in the picture"
        picture.thumbnail(TILE, Image.LANCZOS)
        corner = (n % 4 * TILE[0], n // 4 * TILE[1])
        sheet.paste(picture, (corner[0] + (TILE[0] - picture.width) // 2, corner[1] + TILE[1] - picture.height))
        ImageDraw.Draw(sheet).text((corner[0] + 8, corner[1] + 6), title, fill=(40, 40, 40))
        print(f"drawn  {title}")
    sheet.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(sys.argv[4], optimize=True)


if __name__ == "__main__":
    main()

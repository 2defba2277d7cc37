"""usage: blender -b --python blender_volume.py -- VOLUME.vdb COLOUR_GRID OUT.png AZIMUTH ELEVATION

Draws the fog volume "density" of an OpenVDB file with Cycles, in the colours of a vector grid: y up.
"""
import math
import sys

import bpy
from mathutils import Matrix, Vector

volume_file, colour_grid, out, azimuth, elevation = sys.argv[sys.argv.index("--") + 1:]
azimuth, elevation = math.radians(float(azimuth)), math.radians(float(elevation))

bpy.ops.object.select_all(action="SELECT")
bpy.ops.object.delete()
bpy.ops.object.volume_import(filepath=volume_file, align="WORLD", location=(0, 0, 0))
volume = bpy.context.object
volume.rotation_euler = (0, 0, 0)
volume.data.grids.load()
assert {"density", colour_grid} <= {grid.name for grid in volume.data.grids}, list(volume.data.grids)
bpy.context.view_layer.update()
corners = [volume.matrix_world @ Vector(corner) for corner in volume.bound_box]
centre = sum(corners, Vector()) / 8
radius = max((corner - centre).length for corner in corners)

material = bpy.data.materials.new("fog")
material.use_nodes = True
nodes, links = material.node_tree.nodes, material.node_tree.links
nodes.clear()
output, fog, colour = (nodes.new(f"ShaderNode{kind}") for kind in ("OutputMaterial", "VolumePrincipled", "Attribute"))
fog.inputs["Density"].default_value = 2000 / radius  # opaque within a voxel or two
fog.inputs["Density Attribute"].default_value = "density"
colour.attribute_name = colour_grid
links.new(colour.outputs["Color"], fog.inputs["Color"])
links.new(fog.outputs["Volume"], output.inputs["Volume"])
volume.data.materials.append(material)

towards = Vector((math.sin(azimuth) * math.cos(elevation), math.sin(elevation),
                  math.cos(azimuth) * math.cos(elevation)))
right = Vector((0, 1, 0)).cross(towards).normalized()
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.data.angle_y, camera.data.sensor_fit = math.radians(30), "VERTICAL"
camera.data.clip_start, camera.data.clip_end = radius / 100, radius * 10
camera.matrix_world = Matrix.Translation(centre + towards * radius * 3) @ Matrix(
    (right, towards.cross(right), towards)).transposed().to_4x4()
bpy.context.collection.objects.link(camera)
sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
sun.data.energy = 4
sun.matrix_world = camera.matrix_world
bpy.context.collection.objects.link(sun)

scene = bpy.context.scene
scene.camera = camera
scene.world = bpy.data.worlds.new("white")
scene.world.use_nodes = True
scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
scene.view_settings.view_transform = "Standard"
scene.render.engine = "CYCLES"
scene.cycles.use_denoising = False  # Debian builds without the denoiser
scene.cycles.samples = 24
scene.cycles.volume_bounces = 2
scene.cycles.volume_step_rate = 0.5
scene.render.resolution_x, scene.render.resolution_y = 640, 480
scene.render.filepath = out
bpy.ops.render.render(write_still=True)

// Generated triangle meshes, for the tests of the pipeline.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "mesh/triangle_mesh.h"

namespace voxelpipe::testing {

// A mesh of one part without attributes.
TriangleMesh MakeMesh(std::vector<Vec3d> positions, std::vector<std::array<uint32_t, 3>> triangles);

// Axis-aligned cube [0, size]^3, 12 triangles, outward winding.
TriangleMesh Cube(double size);
// The octahedron |x|+|y|+|z| <= r, rotated by `turn` (a rotation matrix), centred at `centre`.
TriangleMesh Octahedron(double r, const Mat4d& turn, const Vec3d& centre);
// A closed sphere-like surface with bumps: `rings` x 2*rings quads split in two, seeded noise on the radius.
TriangleMesh BumpySphere(int rings, uint32_t seed);
// Torus of radii 1 and 0.4 with n x n quads.
TriangleMesh Torus(int n);
// Random triangles: small, slivers, collinear, points, huge, outside, on lattice planes. Coordinates about [0, extent].
TriangleMesh Soup(int triangles, double extent, uint32_t seed);
// The same with all attributes that shaders read: normals, tangents, both sets of uv, an attribute _HEAT, a textured
// material that masks by alpha, and vertex colours that try conversions: -0, infinities, NaN, subnormals, ties and
// values out of every format's range. Two parts.
TriangleMesh AttributedSoup(int triangles, double extent, uint32_t seed);

// Rotation about a unit axis by an angle in radians.
Mat4d Rotation(const Vec3d& axis, double angle);

}  // namespace voxelpipe::testing

// Meshes that benchmarks are made on, by code: the same on every machine but for the last bits of sin and cos.
#pragma once

#include "mesh/triangle_mesh.h"

namespace voxelpipe::bench {

// A closed sphere with bumps, about `triangles` triangles, in [0, 1]^3.
TriangleMesh BumpySphere(int64_t triangles);
// A closed torus with bumps, about `triangles` triangles.
TriangleMesh BumpyTorus(int64_t triangles);
// Every triangle in four, `times` times over, new vertices moved by a tenth of the edge.
TriangleMesh Subdivided(const TriangleMesh& mesh, int times);
// 92 triangles that span the whole mesh, and 120,000 tiny ones in 40 clusters, in random order.
TriangleMesh Mixed();
// 12 tilted planes that span [0, 1]^3 (two triangles each, ending outside it) and 2,000,000 tiny triangles in 40
// clusters, none sharing vertices, in random order: uneven load on purpose.
TriangleMesh Nasty();

}  // namespace voxelpipe::bench

// Generated meshes for benchmarks: the same on every machine, except for the last bits of sin and cos.
#pragma once

#include "mesh/triangle_mesh.h"

namespace voxelpipe::bench {

// A closed sphere with bumps, about `triangles` triangles, in [0, 1]^3.
TriangleMesh BumpySphere(int64_t triangles);
// A closed torus with bumps, about `triangles` triangles.
TriangleMesh BumpyTorus(int64_t triangles);
// Every triangle in four, `times` times over, new vertices moved by a tenth of the edge.
TriangleMesh Subdivided(const TriangleMesh& mesh, int times);
// At most `triangles` triangles, nearly as many: the vertices of each cell of a lattice become their mean, and
// triangles that keep three corners stay. Source: J. Rossignac, P. Borrel, "Multi-resolution 3D approximations for
// rendering complex scenes", 1993.
TriangleMesh Decimated(const TriangleMesh& mesh, int64_t triangles);
// 92 triangles that span the whole mesh, and 120,000 tiny ones in 40 clusters, in random order.
TriangleMesh Mixed();
// 12 tilted planes that span [0, 1]^3 (two triangles each, ending outside it) and 2,000,000 tiny triangles in 40
// clusters, none sharing vertices, in random order: uneven load on purpose.
TriangleMesh Nasty();
// The walls of a maze of `cells` x `cells` x `cells` rooms in [0, 1]^3, two triangles each and about 4 * cells^3
// together; one way from the opening, on the side z = 0 at the origin, to each room, as a depth-first search finds it.
TriangleMesh Maze(int cells);

}  // namespace voxelpipe::bench

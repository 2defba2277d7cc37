// Assemblies of closed and open bodies whose parts are known: what the engine gets, and the same written out plainly.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "mesh/triangle_mesh.h"

namespace voxelpipe::testing {

struct Body {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  bool closed = true;
};

Body BodyOf(const TriangleMesh& mesh);
Body Box(const Vec3d& low, const Vec3d& high);
Body Icosphere(int subdivisions);  // radius 1
Body Cylinder(int sides);          // radius 1, z from -1 to 1
// Of a closed body, by its own triangles.
double VolumeOf(const Body& body);
double AreaOf(const Body& body);

// p' = M p, with the corners 1 and 2 of every triangle swapped where M mirrors.
Body Moved(Body body, const Mat4d& matrix);
Body InsideOut(Body body);
Mat4d Placing(const Mat4d& turn, double scale, const Vec3d& to);

// A body and what it belongs to, in the numbers of the whole mesh.
struct TaggedBody {
  Body body;  // world space
  size_t file = 0;
  uint32_t instance = 0;  // of a node: numbers of their own
  uint32_t node = 0, mesh = 0, primitive = 0;
  int32_t material = -1;  // -1: none
  std::string node_name, mesh_name;
  bool colors = false;  // it has vertex colours
};

struct FileOf {
  std::string name;
  uint32_t label = 1;
  int32_t priority = 0;
  std::optional<RigidMotionNumbers> motion;
};

struct Assembly {
  TriangleMesh mesh;               // as the engine gets it
  std::vector<TaggedBody> bodies;  // in the order of the triangles
  std::vector<FileOf> files;       // at least one
  std::vector<Material> materials;
};

struct AssemblyKind {
  uint32_t seed = 0;
  int bodies = 2;
  double extent = 16;   // voxels; bodies reach over the border of [0, extent]^3
  bool placed = false;  // several meshes, otherwise one
  bool open = false;    // some bodies lack triangles
  bool moves = false;   // some placed meshes have motions
  bool colors = false;  // some bodies have vertex colours
  bool masks = false;   // some materials discard fragments
};
// Nested, overlapping, touching and disjoint bodies, some of them inside out.
Assembly RandomAssembly(const AssemblyKind& kind);

// One mesh of the bodies, in order, each a run of its own.
TriangleMesh WriteMesh(const std::vector<TaggedBody>& bodies, const std::vector<Material>& materials);

}  // namespace voxelpipe::testing

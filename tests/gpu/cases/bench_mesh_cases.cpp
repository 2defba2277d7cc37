#include "gpu/cases/bench_mesh_cases.h"

#include "gpu/cases/bench_meshes.h"

namespace voxelpipe::gpu {
namespace {

// Blends of a mesh whose triangles lie scattered, in a grid of which the cache does not hold even the bits: they are
// ordered first.
void AddOrdered(std::vector<ParityCase>& cases, int64_t n) {
  struct Wanted {
    Blend blend;
    const char* shader;
    int components;
    ResultKind kind;
    Coverage coverage;
  };
  for (const Wanted& wanted : {Wanted{Blend::kMax, "triangle_id", 1, ResultKind::kDense, Coverage::kConservative},
                               Wanted{Blend::kMin, "triangle_id", 1, ResultKind::kSparse, Coverage::kThin},
                               Wanted{Blend::kAdd, "normal", 3, ResultKind::kSparse, Coverage::kConservative},
                               Wanted{Blend::kAdd, "triangle_id", 1, ResultKind::kDense, Coverage::kThin}}) {
    ParityCase c;
    c.request.grid = UnitCube(n);
    c.request.coverage = wanted.coverage;
    c.request.result = wanted.kind;
    TargetSpec& target = c.request.targets[0];
    target.format = VoxelFormat::kF32;
    target.components = wanted.components;
    target.blend = wanted.blend;
    target.shader = {wanted.shader, {}};
    cases.push_back(c);
  }
  // A part of the cube, for the whole would take much of the host's memory.
  ParityCase part;
  part.request.grid = UnitCube(n);
  part.request.grid.dims->at(2) = n / 3;
  TargetSpec& target = part.request.targets[0];
  target.format = VoxelFormat::kF32;
  target.components = 2;
  target.blend = Blend::kAdd;
  target.shader = {"normal", {}};
  target.clear = -1;
  cases.push_back(part);
}

// Largest and least values of such a mesh, which are written with its largest triangles in them.
void AddFilled(std::vector<ParityCase>& cases, int64_t n) {
  TargetSpec most, least, least_id;
  most.format = least.format = VoxelFormat::kF32;
  least_id.format = VoxelFormat::kU32;
  most.blend = Blend::kMax;
  least.blend = least_id.blend = Blend::kMin;
  most.shader = least_id.shader = {"triangle_id", {}};
  least.shader = {"normal", {}};
  ParityCase c;
  c.request.grid = UnitCube(n);
  c.request.targets = {most};
  cases.push_back(c);
  c.request.coverage = Coverage::kThin;
  c.request.targets = {least, TargetSpec(), least_id};
  cases.push_back(c);
  // Rows of bits that are no whole units of 16 bytes.
  ParityCase bits;
  bits.request.grid = UnitCube(n);
  bits.request.grid.dims->at(0) = n + 70;
  cases.push_back(bits);
}

// Plain bits of such a mesh in a grid of which the cache holds a small part only.
void AddOrderedBits(std::vector<ParityCase>& cases, int64_t n) {
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
    ParityCase c;
    c.request.grid = UnitCube(n);
    c.request.grid.dims->at(2) = n / 3;
    c.request.coverage = coverage;
    cases.push_back(c);
  }
}

// Plain bits of a fine mesh in such a grid, which are set in bricks first; and with rows that are no whole units of 16
// bytes.
void AddBricks(std::vector<ParityCase>& cases, int64_t n) {
  AddOrderedBits(cases, n);
  ParityCase c = cases.back();
  c.request.grid.dims->at(0) = n - 43;
  c.request.grid.dims->at(1) = n - 1;
  cases.push_back(c);
}

// Largest and least values of four components of a fine mesh, which are blended as its triangles are found.
void AddFours(std::vector<ParityCase>& cases, int64_t n) {
  for (const Blend blend : {Blend::kMax, Blend::kMin}) {
    ParityCase c;
    c.request.grid = UnitCube(n);
    if (blend == Blend::kMin) c.request.coverage = Coverage::kThin;
    TargetSpec& target = c.request.targets[0];
    target.format = VoxelFormat::kF32;
    target.components = 4;
    target.blend = blend;
    target.shader = {blend == Blend::kMax ? "normal" : "triangle_id", {}};
    cases.push_back(c);
  }
}

}  // namespace

std::vector<ParityCase> BenchMeshCases(const std::string& mesh) {
  std::vector<ParityCase> cases;
  for (const int64_t n : {512, 1024}) {
    ParityCase c;
    c.request.grid.fit = GridFit::kCube;
    c.request.grid.resolution = n;
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
      c.request.coverage = coverage;
      cases.push_back(c);
    }
    if (n > 512 && mesh == "nasty") {
      AddOrdered(cases, n);
      AddOrderedBits(cases, 2 * n);
    }
    if (n > 512 && mesh == "bunny1M") AddBricks(cases, 2 * n);
    if (n > 512) continue;
    if (mesh == "nasty") AddFilled(cases, n);
    if (mesh == "bunny1M" || mesh == "sphere10M") AddFours(cases, n);
    c.request.grid = UnitCube(n);
    c.request.result = ResultKind::kBuckets;
    cases.push_back(c);
    c.request.targets[0] = {};
    c.request.targets[0].format = VoxelFormat::kF32;
    c.request.targets[0].blend = Blend::kAdd;
    for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse}) {
      c.request.result = kind;
      cases.push_back(c);
    }
  }
  return cases;
}

}  // namespace voxelpipe::gpu

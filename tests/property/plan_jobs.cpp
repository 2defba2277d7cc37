#include "property/plan_jobs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"

namespace voxelpipe::testing {
namespace {

class Dice {
 public:
  explicit Dice(uint64_t seed) : engine_(seed * 0x9e3779b97f4a7c15ull + 1) {}
  double Real(double low, double high) { return low + (high - low) * double(engine_() >> 11) * 0x1p-53; }
  // Every order of magnitude is as likely as any other.
  double Scale(double low, double high) { return std::exp(Real(std::log(low), std::log(high))); }
  int64_t Whole(int64_t low, int64_t high) { return low + int64_t(engine_() % uint64_t(high - low + 1)); }
  bool Chance(double share) { return Real(0, 1) < share; }
  Vec3d Point(double low, double high) { return {Real(low, high), Real(low, high), Real(low, high)}; }

 private:
  std::mt19937_64 engine_;
};

// Triangles that share no vertices.
class Loose {
 public:
  void Add(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const auto v = uint32_t(positions_.size());
    positions_.insert(positions_.end(), {a, b, c});
    triangles_.push_back({v, v + 1, v + 2});
  }
  TriangleMesh Take() { return MakeMesh(std::move(positions_), std::move(triangles_)); }

 private:
  std::vector<Vec3d> positions_;
  std::vector<std::array<uint32_t, 3>> triangles_;
};

// A surface of n x n squares over [0, size]^2.
TriangleMesh Terrain(Dice& dice, int64_t n, double size, double height) {
  const double waves = dice.Real(3, 40);
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (int64_t j = 0; j <= n; ++j) {
    for (int64_t i = 0; i <= n; ++i) {
      const double x = double(i) / double(n), z = double(j) / double(n);
      positions.push_back({x * size, height * std::sin(waves * x) * std::cos(waves * z), z * size});
    }
  }
  for (int64_t j = 0; j < n; ++j) {
    for (int64_t i = 0; i < n; ++i) {
      const auto v = uint32_t(i + (n + 1) * j), row = uint32_t(n + 1);
      triangles.push_back({v, v + row, v + 1});
      triangles.push_back({v + 1, v + row, v + row + 1});
    }
  }
  return MakeMesh(std::move(positions), std::move(triangles));
}

// Faces of unit cubes, as block worlds have them.
TriangleMesh Blocks(Dice& dice, int64_t count, int64_t extent) {
  Loose out;
  for (int64_t n = 0; n < count; ++n) {
    const int axis = int(dice.Whole(0, 2));
    Vec3d p{double(dice.Whole(0, extent - 1)), double(dice.Whole(0, extent - 1)), double(dice.Whole(0, extent - 1))};
    Vec3d u{}, v{};
    u[(axis + 1) % 3] = 1;
    v[(axis + 2) % 3] = 1;
    out.Add(p, p + u, p + v);
    out.Add(p + u, p + u + v, p + v);
  }
  return out.Take();
}

void GiveGrid(VoxelizeRequest& request, std::array<int64_t, 3> dims, const Vec3d& origin, const Vec3d& voxel_size) {
  request.grid.dims = dims;
  request.grid.origin = origin;
  request.grid.voxel_size = voxel_size;
}

void MakeShape(Dice& dice, PlanJob& job) {
  const int64_t kind = dice.Whole(0, 12);
  VoxelizeRequest& request = job.request;
  const auto resolution = [&](double low, double high) { request.grid.resolution = int64_t(dice.Scale(low, high)); };
  const auto count = [&](double low, double high) { return int64_t(dice.Scale(low, high)); };
  // A grid of unit voxels, some of them flat or long.
  const auto unit_grid = [&](int64_t low, int64_t high) {
    std::array<int64_t, 3> dims;
    for (int64_t& dim : dims) dim = dice.Whole(low, high);
    if (dice.Chance(0.2)) dims[size_t(dice.Whole(0, 2))] = dice.Whole(1, 16);
    GiveGrid(request, dims, {0, 0, 0}, {1, 1, 1});
    return dims;
  };
  switch (kind) {
    case 0:
    case 1: {
      const int64_t n = count(60, 420);
      job.mesh = Torus(int(n));
      resolution(90, 420);
      job.text = absl::StrCat("torus ", n);
      break;
    }
    case 2: {
      const int64_t n = count(20, 200);
      job.mesh = BumpySphere(int(n), uint32_t(dice.Whole(1, 1000)));
      resolution(90, 420);
      job.text = absl::StrCat("bumpy sphere ", n);
      break;
    }
    case 3: {
      const int64_t n = count(2e4, 3e5);
      const double size = dice.Scale(0.2, 4);  // of a triangle, in voxels
      const std::array<int64_t, 3> dims = unit_grid(60, 300);
      Loose out;
      for (int64_t i = 0; i < n; ++i) {
        Vec3d p{dice.Real(0, double(dims[0])), dice.Real(0, double(dims[1])), dice.Real(0, double(dims[2]))};
        out.Add(p, p + dice.Point(-size, size), p + dice.Point(-size, size));
      }
      job.mesh = out.Take();
      job.text = absl::StrCat("soup of ", n, " triangles of ", size, " voxels");
      break;
    }
    case 4: {
      const int64_t n = count(100, 500);
      job.mesh = Terrain(dice, n, 1, dice.Scale(0.01, 0.3));
      resolution(120, 600);
      job.text = absl::StrCat("terrain ", n);
      break;
    }
    case 5: {
      const int64_t n = count(3e4, 2e5), extent = dice.Whole(60, 250);
      job.mesh = Blocks(dice, n, extent);
      GiveGrid(request, {extent, extent, extent}, {0, 0, 0}, {1, 1, 1});
      job.text = absl::StrCat("blocks, ", n, " faces");
      break;
    }
    case 6: {
      job.hostile = true;
      const int64_t n = count(5e4, 5e5), places = count(1, 300);
      const std::array<int64_t, 3> dims = unit_grid(8, 100);
      std::vector<Vec3d> corners;
      for (int64_t i = 0; i < places; ++i) {
        corners.push_back(
            {double(dice.Whole(0, dims[0])), double(dice.Whole(0, dims[1])), double(dice.Whole(0, dims[2]))});
      }
      // Some on the corners of tiles of 32x8x8 voxels; some as far beside them as rounding puts them.
      const bool tiles = dice.Whole(0, 2) == 0;
      const double beside = dice.Whole(0, 2) == 0 ? dice.Real(1e-6, 2e-4) : 0;
      Loose out;
      for (int64_t i = 0; i < n; ++i) {
        Vec3d p = corners[size_t(dice.Whole(0, places - 1))];
        if (tiles) p = {32 * std::floor(p.x / 32), 8 * std::floor(p.y / 8), 8 * std::floor(p.z / 8)};
        p = p + Vec3d{beside, -beside, beside};
        out.Add(p, p, p);
      }
      job.mesh = out.Take();
      job.text = absl::StrCat(n, " points on ", places, tiles ? " tile" : " voxel", " corners",
                              beside > 0 ? absl::StrCat(" but for ", beside) : "");
      break;
    }
    case 7: {
      job.hostile = true;
      const std::array<int64_t, 3> dims = unit_grid(60, 250);
      const int64_t n = count(3e3, 5e4);
      Loose out;
      for (int64_t i = 0; i < n; ++i) {
        const auto end = [&] {
          return Vec3d{dice.Real(0, double(dims[0])), dice.Real(0, double(dims[1])), dice.Real(0, double(dims[2]))};
        };
        const Vec3d a = end(), b = end();
        out.Add(a, b, a + dice.Point(-0.01, 0.01));
      }
      job.mesh = out.Take();
      job.text = absl::StrCat(n, " slivers");
      break;
    }
    case 8: {
      job.hostile = true;
      const std::array<int64_t, 3> dims = unit_grid(16, 100);
      const int64_t n = count(50, 1500);
      const double reach = dice.Scale(2, 1000);
      Loose out;
      for (int64_t i = 0; i < n; ++i) {
        const auto corner = [&] {
          return Vec3d{dice.Real(-reach, 1 + reach) * double(dims[0]), dice.Real(-reach, 1 + reach) * double(dims[1]),
                       dice.Real(-reach, 1 + reach) * double(dims[2])};
        };
        out.Add(corner(), corner(), corner());
      }
      job.mesh = out.Take();
      job.text = absl::StrCat(n, " giants of ", reach, " grids");
      break;
    }
    case 9: {
      job.hostile = true;
      const int64_t n = count(100, 400);
      job.mesh = Terrain(dice, n, 1, 0.05);
      const double h = dice.Scale(1e-4, 3e-3);
      const std::array<int64_t, 3> dims{dice.Whole(100, 400), dice.Whole(8, 60), dice.Whole(100, 400)};
      GiveGrid(request, dims, {0.4, -0.01, 0.4}, {h, h, h});
      job.text = absl::StrCat("window of voxels of ", h, " into terrain ", n);
      break;
    }
    case 10: {
      job.hostile = true;
      const int64_t n = count(30, 120), times = dice.Whole(2, 20);
      const TriangleMesh one = Torus(int(n));
      job.mesh = one;
      for (int64_t i = 1; i < times; ++i) {
        job.mesh.triangles.insert(job.mesh.triangles.end(), one.triangles.begin(), one.triangles.end());
      }
      job.mesh.parts[0].triangle_count = job.mesh.triangles.size();
      resolution(90, 300);
      job.text = absl::StrCat("torus ", n, " in itself ", times, " times");
      break;
    }
    case 11: {
      job.hostile = true;
      const std::array<int64_t, 3> dims = unit_grid(600, 1300);
      const int64_t n = dice.Whole(1, 3);
      const double size = dice.Scale(1, 50);
      Loose out;
      for (int64_t i = 0; i < n; ++i) {
        const Vec3d p{dice.Real(0, double(dims[0])), dice.Real(0, double(dims[1])), dice.Real(0, double(dims[2]))};
        out.Add(p, p + dice.Point(-size, size), p + dice.Point(-size, size));
      }
      job.mesh = out.Take();
      job.text = absl::StrCat(n, " triangles of ", size, " voxels in a large grid");
      break;
    }
    default: {
      job.hostile = true;
      const int64_t n = count(2e4, 3e5);
      std::array<int64_t, 3> dims = unit_grid(100, 200);
      dims[2] = dice.Whole(200, 1000);
      request.grid.dims = dims;
      const double layer = double(dice.Whole(0, dims[2] - 1));
      Loose out;
      for (int64_t i = 0; i < n; ++i) {
        const Vec3d p{dice.Real(0, double(dims[0])), dice.Real(0, double(dims[1])), layer + dice.Real(0, 1)};
        out.Add(p, p + dice.Point(-1, 1), p + dice.Point(-1, 1));
      }
      job.mesh = out.Take();
      job.text = absl::StrCat(n, " triangles about layer ", layer);
    }
  }
}

TargetSpec MakeTarget(Dice& dice, ResultKind result) {
  TargetSpec target;
  constexpr VoxelFormat kFormats[] = {VoxelFormat::kBit, VoxelFormat::kU8,  VoxelFormat::kU16,
                                      VoxelFormat::kU32, VoxelFormat::kF16, VoxelFormat::kF32};
  constexpr Blend kBlends[] = {Blend::kMax, Blend::kMin, Blend::kAdd, Blend::kAverage, Blend::kReplace};
  constexpr const char* kShaders[] = {"occupancy", "triangle_id", "geometric_normal", "position", "checker"};
  if (dice.Chance(0.3)) return target;  // bits of occupancy
  target.format = kFormats[dice.Whole(0, 5)];
  target.shader.name = kShaders[dice.Whole(0, 4)];
  if (target.format != VoxelFormat::kBit) {
    target.components = int(dice.Whole(1, 4));
    target.blend = result == ResultKind::kBuckets ? Blend::kReplace : kBlends[dice.Whole(0, 4)];
  } else if (result == ResultKind::kBuckets) {
    target.blend = Blend::kOr;
  }
  return target;
}

}  // namespace

PlanJob MakePlanJob(uint64_t seed) {
  Dice dice(seed);
  PlanJob job;
  MakeShape(dice, job);
  VoxelizeRequest& request = job.request;
  request.result = std::array{ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}[size_t(dice.Whole(0, 2))];
  const auto voxels_of = [](const std::array<int64_t, 3>& dims) { return dims[0] * dims[1] * dims[2]; };
  const bool large = request.grid.dims && voxels_of(*request.grid.dims) > int64_t{1} << 27;
  if (large && request.result == ResultKind::kDense) request.result = ResultKind::kSparse;  // gigabytes otherwise
  const bool buckets = request.result == ResultKind::kBuckets;
  request.coverage =
      std::array{Coverage::kConservative, Coverage::kThin, Coverage::kCenter}[size_t(dice.Whole(0, buckets ? 1 : 2))];
  if (!buckets && dice.Chance(0.4)) request.fill = dice.Chance(0.5) ? Fill::kParity : Fill::kFlood;
  request.targets.clear();
  for (int64_t i = dice.Whole(1, 4); i > 0; i -= 2) {
    // A request that cannot be is drawn again: what blends with what is not the subject here.
    VoxelizeRequest one = request;
    do one.targets = {MakeTarget(dice, request.result)};
    while (!ValidateRequest(one).ok());
    request.targets.push_back(one.targets[0]);
  }
  if (dice.Chance(0.2)) request.layout = Layout::kPlanar;
  if (dice.Chance(0.2)) {
    request.vertex_shader.name = "transform";
  }
  request.threads = int(dice.Whole(1, 4));
  job.streamed = request.result == ResultKind::kDense && dice.Chance(0.3);
  if (dice.Chance(0.35)) job.limits.slab_depth = 8 * dice.Whole(1, 8);
  job.limits.max_result_bytes = job.limits.max_working_bytes = uint64_t{1} << 60;
  absl::StrAppend(&job.text, ", ", std::string(Name(request.result)), " ", std::string(Name(request.coverage)),
                  request.fill == Fill::kNone ? "" : absl::StrCat(" ", std::string(Name(request.fill))));
  for (const TargetSpec& target : request.targets) {
    absl::StrAppend(&job.text, " ", std::string(Name(target.format)), "x", target.components, ":",
                    std::string(Name(target.blend)), ":", target.shader.name);
  }
  if (request.grid.dims) {
    const auto& d = *request.grid.dims;
    absl::StrAppend(&job.text, " dims ", d[0], "x", d[1], "x", d[2]);
  } else {
    absl::StrAppend(&job.text, " resolution ", request.grid.resolution);
  }
  absl::StrAppend(&job.text, job.streamed ? " streamed" : "", " threads ", request.threads);
  if (job.limits.slab_depth > 0) absl::StrAppend(&job.text, " slabs of ", job.limits.slab_depth);
  if (request.vertex_shader.name != "identity") absl::StrAppend(&job.text, " ", request.vertex_shader.name);
  return job;
}

}  // namespace voxelpipe::testing

#include "schedule/cost.h"

#include <algorithm>
#include <cmath>

#include "pipeline/plan/plan.h"

namespace voxelpipe {
namespace {

// Constants measured on one core of a Xeon with AVX-512, bunny and dragon at 32 to 1024. A factor of three is accurate
// enough: MeasuredCost corrects them.
constexpr double kNs = 1e-6;             // in ms
constexpr double kJobMs = 0.03;          // any job: binding, planning, small allocations
constexpr double kTriangleNs = 9;        // occupancy bits: fetch, set-up, one or two rows
constexpr double kBitNs = 2;             // occupancy bits: a touched voxel
constexpr double kTileTriangleNs = 100;  // tiles: binning, sorting, set-up once a tile
constexpr double kFragmentNs = 25;       // shade and blend, a target
constexpr double kRecordNs = 40;         // A-buffer: emit, sort, resolve
constexpr double kByteNs = 0.2;          // clear, write and encode results, including fresh pages
constexpr double kParityNs = 0.06;       // a voxel
constexpr double kFloodNs = 1.5;         // a voxel
constexpr double kExportByteNs = 10;     // a byte of the result in a compressed or drawn file

constexpr double kPlainByteLoadNs = 2.5;  // GLB: parse, flatten
constexpr double kTextByteLoadNs = 6;     // glTF with data URIs, OBJ, OFF
constexpr double kDracoByteLoadNs = 60;   // some two bytes a triangle
constexpr double kPlaceMeshNs = 1000;
constexpr double kPlaceTriangleNs = 45;  // with half a vertex, its normal and coordinates
constexpr double kPlainBytesATriangle = 30;
constexpr double kDracoBytesATriangle = 3;

// Planning, a triangle. A refusal measures up to three times, to say what would fit.
constexpr double kMeasureDenseNs = 20;  // a sample of the triangles
constexpr double kMeasureListsNs = 120, kMeasureFillNs = 60;
constexpr double kExamineNs = 200;  // open edges and degenerate triangles, of which requests with a fill are told

// Voxels of the grid; of a cube without a box.
double Voxels(const VoxelizeRequest& request, const MeshFacts& mesh) {
  if (request.grid.dims) {
    const auto& d = *request.grid.dims;
    return double(std::max<int64_t>(1, d[0])) * double(std::max<int64_t>(1, d[1])) * double(std::max<int64_t>(1, d[2]));
  }
  if (mesh.box) {
    if (const auto grid = FitGrid(request.grid, *mesh.box); grid.ok()) return double(grid->voxels());
  }
  const double n = double(request.grid.voxel_size ? 128 : std::max<int64_t>(1, request.grid.resolution)) +
                   2 * double(std::max<int64_t>(0, request.grid.padding));
  return n * n * n;
}

bool IsText(MeshFormat format) {
  return format == MeshFormat::kGltf || format == MeshFormat::kObj || format == MeshFormat::kOff;
}

bool IsCompressed(const MeshFacts& mesh) {
  return mesh.compressed || mesh.format == MeshFormat::kDraco || mesh.format == MeshFormat::k3mf;
}

double Triangles(const MeshFacts& mesh) {
  if (mesh.triangles) return double(*mesh.triangles);
  return double(mesh.file_bytes) / (IsCompressed(mesh) ? kDracoBytesATriangle : kPlainBytesATriangle);
}

uint64_t Whole(double value) {
  return value < 1e18 ? uint64_t(std::max(0.0, value)) : uint64_t(1e18);
}

}  // namespace

JobCost PredictLoadCost(const MeshFacts& mesh) {
  JobCost cost;
  cost.file_bytes = mesh.file_bytes;
  cost.held_bytes = std::max(mesh.file_bytes, mesh.memory_bytes);
  cost.triangles = Whole(Triangles(mesh));
  if (mesh.file_bytes == 0) return cost;
  const double byte_ns = IsCompressed(mesh)    ? kDracoByteLoadNs
                         : IsText(mesh.format) ? kTextByteLoadNs
                                               : kPlainByteLoadNs;
  cost.load_ms = kJobMs + double(mesh.file_bytes) * byte_ns * kNs;
  return cost;
}

JobCost PredictEstimateCost(const VoxelizeRequest& request, const MeshFacts& mesh) {
  JobCost cost = PredictLoadCost(mesh);
  double triangle_ns = request.result == ResultKind::kDense ? kMeasureDenseNs : kMeasureListsNs;
  if (request.fill != Fill::kNone) {
    triangle_ns += kExamineNs + (request.result == ResultKind::kDense ? 0 : kMeasureFillNs);
  }
  cost.load_ms += kJobMs + Triangles(mesh) * triangle_ns * kNs;
  return cost;
}

JobCost PredictCost(const VoxelizeRequest& request, const MeshFacts& mesh) {
  JobCost cost = PredictLoadCost(mesh);
  const double triangles = Triangles(mesh);
  const double voxels = Voxels(request, mesh);
  // A surface across the grid: a few voxels for each cell of its six sides, and at least two for each triangle.
  const double fragments =
      triangles == 0 ? 0 : std::min(2 * triangles + 8 * std::pow(voxels, 2.0 / 3), 8 * voxels + triangles);
  const double occupied = std::min(fragments, voxels);

  const bool plain = request.result == ResultKind::kDense && request.targets.size() == 1 &&
                     request.targets[0].format == VoxelFormat::kBit && request.targets[0].shader.name == "occupancy";
  double output_bytes = 0, value_bytes = 0;
  for (const TargetSpec& target : request.targets) {
    output_bytes += double(TargetBytes(target, Whole(voxels)));
    value_bytes += std::max(0.125, double(TargetBytes(target, 1024)) / 1024);
  }
  double ns = 0;
  if (request.result == ResultKind::kBuckets) {
    output_bytes = fragments * (4 + value_bytes) + occupied * 16;
    ns += fragments * (kRecordNs + kFragmentNs * double(request.targets.size())) + triangles * kTileTriangleNs;
  } else if (plain) {
    ns += triangles * kTriangleNs + occupied * kBitNs + output_bytes * kByteNs;
  } else {
    ns += triangles * kTileTriangleNs + fragments * kFragmentNs * double(request.targets.size());
    if (request.result == ResultKind::kSparse) {
      output_bytes = occupied * (1 + value_bytes);  // a brick is 72 bytes, and has some hundred of these
      ns += voxels / 8 * kByteNs;
    }
    ns += output_bytes * kByteNs;
  }
  if (CastsLines(request.fill)) ns += voxels * kParityNs;
  if (request.fill == Fill::kFlood) ns += voxels * kFloodNs;

  cost.voxels = Whole(voxels);
  cost.output_bytes = Whole(output_bytes);
  // Positions, indices and positions in index space; coverage bits; the result.
  cost.device_bytes =
      Whole(triangles * 48 + voxels / 8 + output_bytes + (request.result == ResultKind::kBuckets ? fragments * 24 : 0));
  cost.run_ms = kJobMs + ns * kNs;
  return cost;
}

double PredictPlaceMs(size_t meshes, uint64_t triangles) {
  return (double(meshes) * kPlaceMeshNs + double(triangles) * kPlaceTriangleNs) * kNs;
}

double PredictExportMs(const JobCost& cost) {
  return double(cost.output_bytes) * kExportByteNs * kNs;
}

namespace {

constexpr double kMaxRatio = 64;
// Weight of one batch against all before it.
constexpr double kNews = 0.1;
// Batches shorter than this measure the clock and the scheduler rather than the work.
constexpr double kMinMs = 0.001;

}  // namespace

MeasuredCost::MeasuredCost() {
  for (auto& kind : ratios_) kind.fill(1);
}

void MeasuredCost::Observe(WorkKind kind, SizeClass size, double predicted_ms, double measured_ms) {
  if (predicted_ms <= 0) return;
  const double ratio = std::max(measured_ms, kMinMs) / std::max(predicted_ms, kMinMs);
  double& known = ratios_[size_t(kind)][size_t(size)];
  // In logarithms: half and twice as long cancel each other, and one outlier moves little.
  const double step = std::clamp(std::log(ratio / known), -2.0, 2.0);
  known = std::clamp(known * std::exp(kNews * step), 1 / kMaxRatio, kMaxRatio);
}

}  // namespace voxelpipe

#include "fuzz/fuzz_checks.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "cpu/rows/row_kernels.h"
#include "grid/index_space.h"
#include "pipeline/voxelize.h"
#include "shaders/catalog.h"

namespace voxelpipe::fuzz {
namespace {

using Arrays = std::vector<std::vector<uint8_t>>;

Arrays Copy(const VoxelizeResult& result) {
  Arrays arrays;
  for (const auto bytes : ArraysOf(result)) arrays.emplace_back(bytes.begin(), bytes.end());
  return arrays;
}

class GatherSink : public ResultSink {
 public:
  absl::Status Begin(const ResultHeader& header) override {
    arrays.resize(header.arrays.size());
    return absl::OkStatus();
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    arrays[array].insert(arrays[array].end(), bytes.begin(), bytes.end());
    return absl::OkStatus();
  }
  Arrays arrays;
};

bool CanDiscard(const VoxelizeRequest& request) {
  return std::any_of(request.targets.begin(), request.targets.end(), [](const TargetSpec& target) {
    return FindShader(ShaderStage::kFragment, target.shader.name)->can_discard;
  });
}

bool DependsOnOrder(const VoxelizeRequest& request) {
  return request.result == ResultKind::kBuckets ||
         std::any_of(request.targets.begin(), request.targets.end(), [](const TargetSpec& target) {
           return target.blend == Blend::kReplace || target.blend == Blend::kFirst ||
                  target.shader.name == "triangle_id";
         });
}

// One run after the other, the first error kept.
class Checker {
 public:
  explicit Checker(const FuzzCase& made) : mesh_(made.mesh), request_(made.request) {
    request_.simd = SimdChoice::kScalar;
    request_.threads = 1;
  }

  std::string Check() {
    const VoxelizeResult base = Run(request_, "the request");
    if (!error_.empty()) return error_;
    CheckVariants(Copy(base));
    if (error_.empty()) CheckMeaning(base);
    return error_;
  }

 private:
  VoxelizeResult Run(const VoxelizeRequest& request, const std::string& what, int64_t slab_depth = 0) {
    return Run(mesh_, request, what, slab_depth);
  }

  VoxelizeResult Run(const TriangleMesh& mesh, const VoxelizeRequest& request, const std::string& what,
                     int64_t slab_depth = 0) {
    const JobContext job;
    PlanLimits limits;
    limits.slab_depth = slab_depth;
    auto result = Voxelize(mesh, request, {job, limits});
    if (!result.ok()) {
      error_ += absl::StrCat(what, ": ", result.status().ToString(), "\n");
      return {};
    }
    return *std::move(result);
  }

  // The same request with one coverage target and nothing else.
  VoxelizeRequest Plain(Coverage coverage, Fill fill) const {
    VoxelizeRequest plain;
    plain.grid = request_.grid;
    plain.coverage = coverage;
    plain.fill = fill;
    plain.simd = SimdChoice::kScalar;
    plain.threads = 1;
    return plain;
  }

  void CheckVariants(const Arrays& expected) {
    const auto compare = [&](const Arrays& got, const std::string& what) {
      if (error_.empty() && got != expected) error_ += absl::StrCat("other bytes: ", what, "\n");
    };
    for (const SimdChoice simd : {SimdChoice::kScalar, SimdChoice::kAvx2, SimdChoice::kAvx512}) {
      if (!cpu::SelectRowKernels(simd).ok()) continue;
      for (const int threads : {1, 2}) {
        VoxelizeRequest variant = request_;
        variant.simd = simd;
        variant.threads = threads;
        const std::string what = absl::StrCat(std::string(Name(simd)), ", threads ", threads);
        compare(Copy(Run(variant, what)), what);
        if (threads == 2) compare(Copy(Run(variant, what + ", slabs", 8)), what + ", slabs");
      }
    }
    if (!error_.empty()) return;
    const JobContext job;
    PlanLimits limits;
    limits.slab_depth = 8;
    GatherSink sink;
    if (const auto stats = VoxelizeTo(mesh_, request_, {job, limits}, sink); !stats.ok()) {
      error_ += absl::StrCat("streamed: ", stats.status().ToString(), "\n");
    } else {
      // What stands in memory is handed over whole unless the sink wants it streamed, which this one does.
      compare(sink.arrays, "streamed");
    }
    if (DependsOnOrder(request_)) return;
    TriangleMesh turned = mesh_;
    std::reverse(turned.triangles.begin(), turned.triangles.end());
    compare(Copy(Run(turned, request_, "reversed")), "triangles reversed");
  }

  void CheckMeaning(const VoxelizeResult& base) {
    const std::vector<IndexTriangle> triangles = IndexTriangles(mesh_, base.grid);
    const uint64_t voxels = base.grid.voxels();
    if (request_.coverage == Coverage::kNone) {
      CheckKinds(triangles, nullptr, Filled(triangles, base.grid, VoxelFlags(voxels, 0)));
      return;
    }
    const VoxelizeResult plain = Run(Plain(request_.coverage, Fill::kNone), "plain bits");
    const VoxelizeResult counts = Run(Counts(), "counts");
    if (!error_.empty()) return;
    const VoxelFlags covered = Flags(plain.targets[0], voxels);
    error_ += CheckCoverage(triangles, base.grid, request_.coverage, covered);
    const VoxelFlags filled = Filled(triangles, base.grid, covered);
    if (!error_.empty()) return;

    for (uint64_t n = 0; n < voxels && error_.empty(); ++n) {
      if (covered[n] != uint8_t(counts.targets[0].data()[4 * n] != 0)) {
        error_ += absl::StrCat("voxel ", n, ": plain bits and tiles differ\n");
      }
    }
    CheckKinds(triangles, &counts, filled);
  }

  // Dense, sparse and bucketed results of the same targets. What shaders discard is compared between dense and sparse
  // alone. `counts`: of fragments; null where no voxel is covered.
  void CheckKinds(const std::vector<IndexTriangle>& triangles, const VoxelizeResult* counts, const VoxelFlags& filled) {
    if (!error_.empty()) return;
    const bool discards = counts != nullptr && CanDiscard(request_);
    VoxelizeRequest other = request_;
    other.result = ResultKind::kDense;
    const VoxelizeResult dense = Run(other, "dense");
    other.result = ResultKind::kSparse;
    const VoxelizeResult sparse = Run(other, "sparse");
    if (!error_.empty()) return;
    error_ += CheckSparse(sparse, dense, discards ? nullptr : &filled);
    if (discards || !error_.empty()) return;
    const uint64_t occupied = uint64_t(std::count(filled.begin(), filled.end(), uint8_t{1}));
    if (dense.stats.occupied != occupied || sparse.stats.occupied != occupied) {
      error_ += absl::StrCat("occupied: dense ", dense.stats.occupied, ", sparse ", sparse.stats.occupied, ", counted ",
                             occupied, "\n");
    }
    if (counts == nullptr) {
      error_ += CheckValues(request_, dense, nullptr, filled);
      if (dense.stats.fragments != 0 || sparse.stats.fragments != 0) error_ += "fragments without coverage\n";
      return;
    }
    if (request_.coverage == Coverage::kCenter) return;  // has no buckets
    other.result = ResultKind::kBuckets;
    other.fill = Fill::kNone;
    const VoxelizeResult buckets = Run(other, "buckets");
    if (!error_.empty()) return;
    error_ += CheckBuckets(buckets, *counts, triangles, request_.coverage);
    if (error_.empty()) error_ += CheckValues(request_, dense, &buckets, filled);
    if (buckets.stats.fragments != buckets.listed_fragments() ||
        counts->stats.fragments != buckets.listed_fragments()) {
      error_ += "fragments: the statistics do not agree with the lists\n";
    }
  }

  VoxelizeRequest Counts() const {
    VoxelizeRequest counts = Plain(request_.coverage, Fill::kNone);
    counts.targets[0].format = VoxelFormat::kU32;
    counts.targets[0].blend = Blend::kCount;
    return counts;
  }

  // The checked result of the request's fill over `covered`.
  VoxelFlags Filled(const std::vector<IndexTriangle>& triangles, const GridSpec& grid, const VoxelFlags& covered) {
    if (request_.fill == Fill::kNone || !error_.empty()) return covered;
    const VoxelizeResult solid = Run(Plain(request_.coverage, request_.fill), "solid bits");
    if (!error_.empty()) return covered;
    VoxelFlags filled = Flags(solid.targets[0], grid.voxels());
    if (CastsLines(request_.fill)) {
      const uint64_t odd_columns = solid.stats.odd_columns.value_or(~uint64_t{0});
      error_ += CheckCrossings(request_.fill, triangles, grid, covered, filled, odd_columns);
    } else {
      const VoxelizeResult shell = Run(Plain(Coverage::kConservative, Fill::kNone), "shell");
      if (error_.empty()) error_ += CheckFlood(grid, Flags(shell.targets[0], grid.voxels()), covered, filled);
    }
    return filled;
  }

  const TriangleMesh& mesh_;
  VoxelizeRequest request_;
  std::string error_;
};

}  // namespace

std::vector<IndexTriangle> IndexTriangles(const TriangleMesh& mesh, const GridSpec& grid) {
  std::vector<IndexTriangle> triangles;
  for (const auto& t : mesh.triangles) {
    IndexTriangle& out = triangles.emplace_back();
    for (size_t i = 0; i < 3; ++i) out.v[i] = WorldToIndex(grid.index_space(), mesh.positions[t[i]]);
  }
  return triangles;
}

VoxelFlags Flags(const HostBuffer& bits, uint64_t voxels) {
  VoxelFlags flags(voxels);
  for (uint64_t n = 0; n < voxels; ++n) flags[n] = (bits.data()[n / 8] >> (n % 8)) & 1;
  return flags;
}

std::string CheckCase(const FuzzCase& made) {
  return Checker(made).Check();
}

}  // namespace voxelpipe::fuzz

// The CUDA backend gives the CPU's bytes: valid combinations of coverages, fills, targets, blends, shaders, layouts,
// grids, slabs and result kinds on more than thirty meshes, through the public entry points; each device run repeated.
//
// usage: cuda_parity [OPTION]... [--files FILE...]
//   --quick         each kernel once or twice on small meshes: for a sanitizer
//   --batches       the batches alone
//   --bench-meshes  the benchmark's meshes at 512^3 and 1024^3 instead
//   --bunny FILE    of --bench-meshes: a bunny of 69,451 triangles
//   --cache BYTES   assumed size of the L2 cache: small grids then take the paths of large ones
//   --span-limits   spans number slabs of eight layers and lists of 64 triangles: many slabs, many lists
//   --paths         every path that the options allow must have run, with a filter too
//   --every K       one of K cases of each mesh, and no batches
//   --filter TEXT   only cases whose line holds TEXT; a line begins "MESH#NUMBER "
//   --seed N        other random meshes and requests
//   --budget S      stop after so many seconds, which counts as a failure
//   --list          print the cases' lines alone
//   --self          the CPU's scalar rows stand in for the device: checks this program where there is none
//   --files         also these mesh files, to the end of the line
// Where all cases run every path that the options lead to has to have run.
// Exit: 0 all alike, 1 some differ or a path never ran, 2 none differ but some are not implemented, 77 no CUDA device.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "base/memory_budget.h"
#include "gpu/cases/batch_cases.h"
#include "gpu/cases/bench_mesh_cases.h"
#include "gpu/cases/bench_meshes.h"
#include "gpu/cases/parity_cases.h"
#include "gpu/cases/parity_options.h"
#include "gpu/cases/parity_subjects.h"
#include "gpu/cases/part_cases.h"
#include "gpu/parity/batch_parity.h"
#include "gpu/parity/first_difference.h"
#include "gpu/parity/memory_parity.h"
#include "gpu/parity/parity_paths.h"
#include "gpu/parity/parity_run.h"
#include "mesh/content_id.h"
#include "pipeline/stages/backend.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"
#ifdef VOXELPIPE_HAVE_CUDA
#include "cuda/device/device.h"
#include "cuda/device/mesh_uploads.h"
#include "cuda/plan/path_plan.h"
#endif

namespace voxelpipe::gpu {
namespace {

class Parity {
 public:
  explicit Parity(const ParityOptions& options) : options_(options) {}

  // False: the time is up, or the device answers nothing any more.
  // `repeats`: device runs a case; 0: two, and ten of every tenth.
  bool RunMesh(const ParityMesh& named, const TriangleMesh& mesh, const std::vector<ParityCase>& cases,
               int repeats = 0) {
    const auto begin = Now();
    const uint64_t before = cases_;
    for (size_t i = 0; i < cases.size(); ++i) {
      const std::string line = absl::StrCat(named.name, "#", i, " ", Describe(cases[i]));
      if (!options_.filter.empty() && !absl::StrContains(line, options_.filter)) continue;
      if (numbered_++ % options_.every != 0) continue;
      if (options_.list) std::printf("%s\n", line.c_str());
      if (options_.list) continue;
      if (Seconds(started_) > options_.budget_s) return Stop("the time is up");
      RunCase(named, mesh, cases[i], line, repeats > 0 ? repeats : cases_ % 10 == 0 ? 10 : 2);
      if (failed_in_a_row_ >= 10) return Stop("ten cases in a row failed");
    }
    if (cases_ > before && !options_.quick) {
      std::printf("%-24s %8zu triangles %5llu cases %6.1f s\n", named.name.c_str(), mesh.triangles.size(),
                  static_cast<unsigned long long>(cases_ - before), Seconds(begin));
      std::fflush(stdout);
    }
    meshes_ += cases_ > before;
    return true;
  }

  // A mesh that the device keeps, and then others that share all but their positions with it: what each gives is what
  // it gives as a mesh of its own, and its positions alone go up. Single runs, and all frames in one batch.
  bool RunMoved(const ParityMesh& named, TriangleMesh mesh, const std::vector<ParityCase>& cases,
                BatchParity& batches) {
    mesh.content_id = "moved " + named.name;
    if (!RunMesh({named.name + "_kept", named.extent, {}}, mesh, cases, 1)) return false;
    for (int frame = 1; frame <= 2; ++frame) {
      auto moved = std::make_shared<TriangleMesh>(mesh);
      moved->content_id = NewMovedId(mesh.content_id);
      for (Vec3d& p : moved->positions) p = Vec3d{p.x, p.y * (1 + 0.25 * frame), p.z + 0.125 * frame * p.x};
      const std::string name = absl::StrCat(named.name, "_moved", frame);
      if (!RunMesh({name, named.extent, {}}, *moved, cases, 1)) return false;
      CheckUpload(name, *moved, {}, moved->positions.size() * sizeof(Vec3d));
      if (options_.filter.empty() && !options_.list && options_.every == 1) batches.Add(name, moved, cases, 1);
    }
    return true;
  }

  // Every vertex shader on the mesh, then on one that the device keeps: once it was there, poses and parameters alone
  // go up.
  bool RunVertexShaders(const ParityMesh& named, TriangleMesh mesh) {
    const std::vector<ParityCase> cases = VertexShaderCases(named, mesh);
    if (!RunMesh({named.name + "_shaded", named.extent, {}}, mesh, cases, 1)) return false;
    mesh.content_id = "shaded " + named.name;
    if (!RunMesh({named.name + "_shaded_kept", named.extent, {}}, mesh, cases, 1)) return false;
    for (const ParityCase& c : cases) CheckUpload(named.name + "_shaded_kept " + Describe(c), mesh, c, 0);
    return true;
  }

  // Less and less device memory, told before the run, and found out once vertices are shaded: the same bytes by more
  // and thinner slabs, until not even the thinnest fits, which is RESOURCE_EXHAUSTED; then there is room again.
  bool RunShortOfMemory(const ParityMesh& named, const TriangleMesh& mesh, const std::vector<ParityCase>& cases) {
#ifdef VOXELPIPE_HAVE_CUDA
    std::set<int> seen[2];  // numbers of slabs
    bool whole = !options_.self && !options_.list;
    for (size_t i = 0; i < cases.size() && !options_.self; ++i) {
      ParityCase c = cases[i];
      const auto by_slabs = [&](bool told, uint64_t room, int& slabs) {
        bool begun = false;
        slabs = 0;
        const JobContext job([&](std::string_view stage, double fraction) {
          slabs += fraction > 0;
          if (told || begun || stage == "vertex_shade" || stage == "plan") return;
          begun = true;
          cuda::LimitMemory(cuda::MemoryTaken() + room);
        });
        if (told) cuda::LimitMemory(cuda::MemoryTaken() + room);
        absl::StatusOr<Delivered> result = Run(mesh, c, job);
        cuda::LimitMemory(UINT64_MAX);
        return result;
      };
      const std::string line = absl::StrCat(named.name, "_short#", i, " ", Describe(c));
      whole = whole && absl::StrContains(line, options_.filter);
      if (!absl::StrContains(line, options_.filter)) continue;
      if (options_.list) std::printf("%s\n", line.c_str());
      if (options_.list) continue;
      if (Seconds(started_) > options_.budget_s) return Stop("the time is up");
      ++cases_;
      c.request.backend = BackendChoice::kCpu;
      const absl::StatusOr<Delivered> expected = Run(mesh, c);
      c.request.backend = BackendChoice::kCuda;
      for (const bool told : {true, false}) {
        absl::StatusOr<Delivered> got = expected;
        for (uint64_t room = 12 << 20; got.ok() && room >= 1 << 10; room /= 2) {
          int slabs = 0;
          got = by_slabs(told, room, slabs);
          ++runs_;
          if (!got.ok()) {
            const std::string why = Message(got.status());
            const bool says_need = absl::StrContains(why, "bytes of device memory needed");
            if (!absl::StartsWith(why, "RESOURCE_EXHAUSTED") || !says_need || (c.enough > 0 && room >= c.enough))
              Differ(c, line, absl::StrCat(room, " bytes: ", why));
            continue;
          }
          if (!c.streamed) seen[told].insert(slabs);
          if (const auto difference = FirstDifference(*expected, *got))
            Differ(c, line, absl::StrCat(room, " bytes, ", slabs, " slabs: ", *difference));
        }
        if (got.ok()) Differ(c, line, "1 KiB was enough");
        got = Run(mesh, c);
        if (!got.ok() || FirstDifference(*expected, *got)) Differ(c, line, "it is wrong with enough memory afterwards");
      }
    }
    for (const bool told : {true, false}) {
      // Which numbers there are depends on what else takes memory; where it is found out, slabs end where there is no
      // room for two.
      if (!whole || (seen[told].size() >= 3 && seen[told].count(1) == 1 && (!told || seen[told].count(7) == 1)))
        continue;
      std::string numbers;
      for (const int n : seen[told]) absl::StrAppend(&numbers, " ", n);
      Differ(cases[0], named.name + "_short",
             absl::StrCat(told ? "told" : "found out", ": slabs in numbers of", numbers));
    }
#else
    (void)named, (void)mesh, (void)cases;
#endif
    return true;
  }

  // A case of memory_parity.h. `find` returns what is wrong.
  template <typename Find>
  void RunAlone(const std::string& line, const ParityCase& c, const Find& find) {
    if (options_.list || options_.self || !absl::StrContains(line, options_.filter)) return;
    ++cases_;
    if (const auto wrong = find()) Differ(c, line, *wrong);
  }

  void RunOutOfMemory() {
    std::string refusal;
    RunAlone("out_of_memory#0 8 x f32x4 dense 28000x28000x8, which are the fewest layers", {},
             [&] { return MoreThanDevicesHave(refusal); });
    if (!refusal.empty()) ++refused_["out of memory: " + refusal];
  }

  // All fragments in one of 64 slabs, where the plan spreads them: what lists come to need more is taken from the job's
  // budget, or refused before the device has it, and given back.
  void RunBeyondThePlan() {
    const std::string line = "beyond_plan#0 bucketed bits of a soup in one slab of 64";
    if (options_.list || !absl::StrContains(line, options_.filter)) return;
    ++cases_;
    ParityCase c;
    c.request.backend = BackendChoice::kCuda;
    c.request.result = ResultKind::kBuckets;
    c.request.grid = Placed({64, 64, 512}, {0, 0, 0}, {1, 1, 1});
    c.slab_depth = 8;
    TriangleMesh mesh = testing::Soup(60000, 64, 11);
    for (Vec3d& p : mesh.positions) p.z = 256 + p.z / 16;
    const auto run = [&](uint64_t limit, uint64_t& peak, uint64_t& used) {
      MemoryBudget budget(limit);
      JobContext job;
      job.set_memory(&budget);
      absl::StatusOr<Delivered> got = Run(mesh, c, job);
      peak = budget.peak_bytes();
      used = budget.used_bytes();
      return got;
    };
    uint64_t peak = 0, used = 0;
    const absl::StatusOr<Delivered> got = run(UINT64_MAX, peak, used);
    c.request.backend = BackendChoice::kCpu;
    const absl::StatusOr<Delivered> expected = Run(mesh, c);
    c.request.backend = BackendChoice::kCuda;
    if (!got.ok() || !expected.ok()) return Differ(c, line, Message(got.ok() ? expected.status() : got.status()));
    if (const auto difference = FirstDifference(*expected, *got)) return Differ(c, line, *difference);
    if (peak == 0 || used != 0) return Differ(c, line, absl::StrCat(peak, " bytes were taken, ", used, " are left"));
    for (const uint64_t limit : {uint64_t{0}, peak / 4}) {  // the run does without some of the rest
      const absl::Status status = run(limit, peak, used).status();
      if (!absl::IsResourceExhausted(status) || DeviceFailureOf(status) || used != 0) {
        return Differ(c, line, absl::StrCat("a budget of ", limit, " bytes: ", Message(status)));
      }
    }
  }

  int Report() const {
    for (const auto& [why, count] : unimplemented_)
      std::printf("unimplemented %llu times: %s\n", static_cast<unsigned long long>(count), why.c_str());
    for (const auto& [why, count] : refused_)
      std::printf("refused alike %llu times: %s\n", static_cast<unsigned long long>(count), why.c_str());
    uint64_t unimplemented = 0;
    for (const auto& [why, count] : unimplemented_) unimplemented += count;
    if (differ_ > 0) PrintTally();
    if (!stopped_.empty()) std::printf("STOPPED early: %s\n", stopped_.c_str());
    std::printf("%s: %llu meshes, %llu device runs, %.1f s on the device's side, %.1f s on the CPU's\n",
                options_.self ? "itself" : "cuda", static_cast<unsigned long long>(meshes_),
                static_cast<unsigned long long>(runs_), device_s_, cpu_s_);
    const bool all_ran = PrintPaths(paths_, options_);
    std::printf("cuda_parity: %llu cases, %llu differ, %llu unimplemented\n", static_cast<unsigned long long>(cases_),
                static_cast<unsigned long long>(differ_), static_cast<unsigned long long>(unimplemented));
    if (differ_ > 0 || cases_ == 0 || !stopped_.empty() || !all_ran) return options_.list ? 0 : 1;
    return unimplemented > 0 ? 2 : 0;
  }

 private:
  using Time = std::chrono::steady_clock::time_point;
  static Time Now() {
    return std::chrono::steady_clock::now();
  }
  static double Seconds(Time since) {
    return std::chrono::duration<double>(Now() - since).count();
  }

  bool Stop(const char* why) {
    stopped_ = why;
    return false;
  }

  // True if another run uploads `bytes` of the mesh, ignoring its small parts.
  void CheckUpload(const std::string& name, const TriangleMesh& mesh, ParityCase c, uint64_t bytes) {
#ifdef VOXELPIPE_HAVE_CUDA
    if (options_.self || options_.list || !options_.filter.empty()) return;
    c.request.backend = BackendChoice::kCuda;
    const uint64_t before = cuda::MeshUploadedBytes(0);
    const auto result = Voxelize(mesh, c.request, {JobContext()});
    const uint64_t uploaded = cuda::MeshUploadedBytes(0) - before;
    const uint64_t small_parts = 64 * (1 + mesh.parts.size()) + 256 * (1 + mesh.materials.size());
    if (!result.ok() || uploaded < bytes || uploaded > bytes + small_parts) {
      Differ(c, name, absl::StrCat(uploaded, " bytes of the mesh went up, not ", bytes));
    }
#else
    (void)name, (void)mesh, (void)c, (void)bytes;
#endif
  }

  void Differ(const ParityCase& c, const std::string& line, const std::string& how) {
    ++differ_;
    for (const std::string& word : FeaturesOf(c)) ++tally_[word].second;
    if (differ_ <= 40) std::printf("DIFFERS %s\n        %s\n", line.c_str(), how.c_str());
    std::fflush(stdout);
  }

  // Which words of requests go with differences.
  void PrintTally() const {
    std::vector<std::pair<double, std::string>> rows;
    for (const auto& [word, counts] : tally_) {
      if (counts.second == 0) continue;
      const double share = double(counts.second) / double(counts.first);
      rows.emplace_back(-share, absl::StrCat(counts.second, " of ", counts.first, " with ", word));
    }
    std::sort(rows.begin(), rows.end());
    for (size_t i = 0; i < rows.size() && i < 24; ++i) std::printf("differ: %s\n", rows[i].second.c_str());
  }

  void RunCase(const ParityMesh& named, const TriangleMesh& mesh, ParityCase c, const std::string& line, int repeats) {
    ++cases_;
    for (const std::string& word : FeaturesOf(c)) ++tally_[word].first;
    ParityCase reference = c;
    reference.slab_depth = 0;
    reference.streamed = false;
    reference.request.backend = BackendChoice::kCpu;
    auto begin = Now();
    const absl::StatusOr<Delivered> expected = Run(mesh, reference);
    cpu_s_ += Seconds(begin);
    if (!expected.ok() && !named.refusable) return Differ(c, line, "the CPU: " + Message(expected.status()));
    c.request.backend = options_.self ? BackendChoice::kCpu : BackendChoice::kCuda;
    if (options_.self) c.request.simd = SimdChoice::kScalar;
    for (int i = 0; i < repeats; ++i) {
      begin = Now();
      const absl::StatusOr<Delivered> got = Run(mesh, c);
      device_s_ += Seconds(begin);
      ++runs_;
      if (!got.ok() && got.status().code() == absl::StatusCode::kUnimplemented) {
        ++unimplemented_[std::string(got.status().message())];
        return;
      }
      failed_in_a_row_ = !got.ok() && expected.ok() ? failed_in_a_row_ + 1 : 0;
      if (!got.ok() || !expected.ok()) {
        const std::string a = expected.ok() ? "a result" : Message(expected.status());
        const std::string b = got.ok() ? "a result" : Message(got.status());
        if (a != b) return Differ(c, line, absl::StrCat("run ", i, ": ", a, " and ", b));
        ++refused_[a];
        return;
      }
      for (const std::string& path : got->stats.path) ++paths_[path];
      if (got->stats.backend != (options_.self ? "cpu" : "cuda"))
        return Differ(c, line, "ran on " + got->stats.backend);
      if (const auto difference = FirstDifference(*expected, *got))
        return Differ(c, line, absl::StrCat("run ", i, ": ", *difference));
    }
  }

  const ParityOptions& options_;
  const Time started_ = Now();
  uint64_t cases_ = 0, differ_ = 0, runs_ = 0, meshes_ = 0;
  int failed_in_a_row_ = 0;
  double device_s_ = 0, cpu_s_ = 0;
  std::string stopped_;
  std::map<std::string, uint64_t> unimplemented_, refused_;
  std::map<std::string, uint64_t> paths_;                       // of targets
  uint64_t numbered_ = 0;                                       // cases, run or not
  std::map<std::string, std::pair<uint64_t, uint64_t>> tally_;  // word of a request -> cases, those that differ
};

// The meshes of the benchmark's table.
void RunBenchMeshes(Parity& parity, const ParityOptions& options) {
  for (const BenchMesh& bench : BenchMeshes(options.bunny, "")) {
    const size_t name = options.filter.find('#');
    if (name != std::string::npos && options.filter.substr(0, name) != bench.name) continue;  // it takes long to make
    if (!parity.RunMesh({bench.name, 1, {}}, bench.make(), BenchMeshCases(bench.name), 1)) return;
  }
}

// A small surface at the far end of grids of more than 2^32 voxels, as one slab and as several.
bool RunBeyond32Bits(Parity& parity, const ParityOptions& options) {
  TriangleMesh mesh = testing::BumpySphere(16, options.seed);
  for (Vec3d& p : mesh.positions) p = p * 30.0 + Vec3d{4070, 4060, 225};
  std::vector<ParityCase> cases;
  ParityCase c;
  c.request.grid.dims = {4097, 4096, 264};
  c.request.grid.origin = Vec3d{0, 0, 0};
  c.request.grid.voxel_size = Vec3d{1, 1, 1};
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    c.request.result = kind;
    for (const int64_t depth : {264, 136}) {
      c.slab_depth = depth;
      cases.push_back(c);
    }
  }
  c.request.result = ResultKind::kDense;
  c.request.targets[0].format = VoxelFormat::kU8;
  c.request.targets[0].blend = Blend::kCount;
  c.slab_depth = 264;
  if (!options.self) cases.push_back(c);  // 4.4 GB
  c.request.result = ResultKind::kSparse;
  c.request.targets[0] = {
      .format = VoxelFormat::kF32, .components = 3, .blend = Blend::kAverage, .shader = {"normal", {}}};
  cases.push_back(c);
  return parity.RunMesh({"beyond_32_bits", 4096, {}}, mesh, cases, 1);
}

// Fills of parts, of meshes that the device keeps too: it has their triangles in the order of ids.
bool RunParts(Parity& parity, const ParityOptions& options) {
  for (const ParityMesh& named : PartMeshes(options.seed, options.quick)) {
    TriangleMesh mesh = named.make();
    std::vector<ParityCase> cases = PartCases(named, options.quick);
    if (!parity.RunMesh(named, mesh, cases, options.quick ? 1 : 0)) return false;
    const ParityCase ranges = CaseOfRanges();
    if (named.name == "parts_rows") {
      parity.RunAlone(absl::StrCat(named.name, "_ranges#0 ", Describe(ranges)), ranges,
                      [&] { return RowsInRanges(mesh, ranges); });
    }
    if (options.quick) continue;
    mesh.content_id = "parts of " + named.name;
    for (size_t i = 0; i < cases.size(); i += 3) cases[i].request.parts = {};
    if (!parity.RunMesh({named.name + "_kept", named.extent, {}}, mesh, cases, 1)) return false;
  }
  return true;
}

void AddTo(BatchParity& batches, const Subject& subject, const ParityOptions& options) {
  if (subject.large || options.every > 1) return;
  batches.Add(subject.named.name, subject.mesh, subject.cases, options.quick ? 1 : 8);
  if (subject.named.extent > 0) batches.AddABuffers(subject.named.name, subject.mesh);
}

void RunBatches(BatchParity& batches, const ParityOptions& options) {
  uint32_t number = 0;
  for (const ParityMesh& named : ParityMeshes(options.seed)) {
    if (const auto subject = MakeSubject(named, ++number, options)) AddTo(batches, *subject, options);
  }
  batches.Finish();
}

void RunAll(Parity& parity, BatchParity& batches, const ParityOptions& options) {
  if (options.bench_meshes) return RunBenchMeshes(parity, options);
  // With span limits a job has several slabs, and shares no pass.
  const bool in_batches = options.filter.empty() && !options.list && !options.span_limits;
  uint32_t number = 0;
  for (const ParityMesh& named : ParityMeshes(options.seed)) {
    ++number;
    const bool quick_rig = options.quick && named.name == "rigged";
    if (quick_rig && !parity.RunVertexShaders(named, named.make())) return;
    const auto subject = MakeSubject(named, number, options);
    if (!subject) continue;
    const TriangleMesh& mesh = *subject->mesh;
    if (!parity.RunMesh(named, mesh, subject->cases, options.quick ? 1 : 0)) return;
    if (number == 1 && !parity.RunShortOfMemory(named, mesh, SlabCases())) return;
    if (number == 1 && !parity.RunMoved(named, mesh, QuickCases(named), batches)) return;
    // What is kept with such a mesh is made of its own positions.
    const bool scattered = named.name == "scattered" && !options.quick;
    if (scattered && !parity.RunMoved(named, mesh, QuickCases(named), batches)) return;
    if (number == 1 && !parity.RunMesh({named.name + "_a_buffer", 40, {}, true}, mesh, FragmentCases(), 1)) return;
    if (subject->rigged && !parity.RunVertexShaders(named, mesh)) return;
    if (in_batches) AddTo(batches, *subject, options);
  }
  if (!RunParts(parity, options)) return;
  if (in_batches) batches.Finish();
  parity.RunAlone("kept_texture#0 of 64x64 texels, by two textures", {}, TextureOfKeptMesh);
  if (!options.self) parity.RunBeyondThePlan();
  if (options.quick) return;
  if (!options.self) parity.RunOutOfMemory();
  if (!RunBeyond32Bits(parity, options)) return;
  for (const std::string& path : options.files) {
    const auto slash = path.rfind('/');
    ParityMesh named{slash == std::string::npos ? path : path.substr(slash + 1), 0, {}, true};
    const TriangleMesh mesh = LoadMeshOrExit(path);
    if (!parity.RunMesh(named, mesh, CasesFor(named, mesh, {24, true, false}, options.seed + 100 * ++number))) return;
  }
}

int Main(int argc, char** argv) {
  ParityOptions options;
  if (!ParseParityOptions(argc, argv, options)) {
    std::fprintf(stderr, "cuda_parity: unknown or incomplete option; see the head of cuda_parity.cpp\n");
    return 1;
  }
  const absl::StatusOr<const Backend*> cuda = SelectBackend(BackendChoice::kCuda);
  if (options.list) options.self = true;
  if (!cuda.ok() && !options.self) {
    std::printf("SKIPPED: no CUDA device (%s)\n", std::string(cuda.status().message()).c_str());
    return 77;
  }
#ifdef VOXELPIPE_HAVE_CUDA
  cuda::AssumeCache(options.cache);
  if (options.span_limits) cuda::SetSpanLimits({.slab_bits = 1, .triangles = 64});
#endif
  Parity parity(options);
  BatchParity batches(options.self ? *Devices().back() : **cuda, options.quick ? 64 : 512);
  if (options.batches) {
    RunBatches(batches, options);
    batches.Report();
    return batches.cases() == 0 || batches.differ() > 0 ? 1 : 0;
  }
  RunAll(parity, batches, options);
  batches.Report();
  const int code = parity.Report();
  return batches.differ() > 0 ? 1 : code;
}

}  // namespace
}  // namespace voxelpipe::gpu

int main(int argc, char** argv) {
  return voxelpipe::gpu::Main(argc, argv);
}

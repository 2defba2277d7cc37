#include "gpu/cases/parity_cases.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <random>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "shaders/catalog.h"

namespace voxelpipe::gpu {

GridRequest Placed(std::array<int64_t, 3> dims, const Vec3d& origin, const Vec3d& voxel) {
  GridRequest grid;
  grid.dims = dims;
  grid.origin = origin;
  grid.voxel_size = voxel;
  return grid;
}

namespace {

class Dice {
 public:
  explicit Dice(uint32_t seed) : random_(seed) {}
  size_t Below(size_t n) { return random_() % n; }
  bool OneIn(size_t n) { return Below(n) == 0; }
  double Real(double lo, double hi) { return lo + (hi - lo) * (double(random_()) * 0x1p-32); }
  template <typename T, size_t kCount>
  const T& Of(const T (&list)[kCount]) {
    return list[Below(kCount)];
  }
  template <typename T>
  const T& Of(const std::vector<T>& list) {
    return list[Below(list.size())];
  }

 private:
  std::mt19937 random_;
};

constexpr Coverage kCoverages[] = {Coverage::kConservative, Coverage::kThin, Coverage::kCenter, Coverage::kNone};
constexpr Fill kFills[] = {Fill::kNone, Fill::kParity, Fill::kFlood, Fill::kNonzero};
constexpr ResultKind kKinds[] = {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets};

bool Valid(ResultKind kind, Coverage coverage, Fill fill) {
  if (coverage == Coverage::kNone) return kind != ResultKind::kBuckets && CastsLines(fill);
  return kind != ResultKind::kBuckets || (coverage != Coverage::kCenter && fill == Fill::kNone);
}

}  // namespace

std::vector<GridRequest> GridsFor(double extent) {
  const auto e = int64_t(extent);
  std::vector<GridRequest> grids;
  const auto unit = [&](int64_t x, int64_t y, int64_t z) { grids.push_back(Placed({x, y, z}, {0, 0, 0}, {1, 1, 1})); };
  unit(e, e, e);
  unit(35, 12, 19);
  unit(31, 7, 9);
  unit(32, 8, 8);
  unit(33, 9, 7);
  unit(64, 16, 24);
  unit(65, 17, 23);
  unit(e + 1, 5, e);
  unit(1, e, 1);
  unit(e, 1, 1);
  unit(1, 1, e);
  grids.push_back(Placed({1, 1, 1}, {3, 3, 3}, {extent, extent, extent}));
  grids.push_back(Placed({e, e - 3, e + 2}, {-1.25, 0.5, 2}, {0.75, 1, 4.0 / 3}));
  grids.push_back(Placed({97, 41, 53}, {extent / 3, extent / 3, extent / 4}, {0.1, 0.125, 0.3}));
  grids.push_back(Placed({13, 11, 10}, {-20, -20, -20}, {7, 6.1, 9}));
  GridRequest fitted;
  fitted.resolution = 37;
  grids.push_back(fitted);
  fitted.fit = GridFit::kCube;
  fitted.padding = 2;
  grids.push_back(fitted);
  return grids;
}

namespace {

// Grids for a mesh that lies anywhere.
std::vector<GridRequest> FittedGrids() {
  std::vector<GridRequest> grids;
  for (const int64_t resolution : {1, 17, 40, 64, 96}) {
    GridRequest grid;
    grid.resolution = resolution;
    grid.fit = resolution % 2 == 0 ? GridFit::kCube : GridFit::kTight;
    grid.padding = resolution == 40 ? 3 : 0;
    grids.push_back(grid);
  }
  return grids;
}

std::vector<ShaderCall> FragmentShadersFor(const TriangleMesh& mesh) {
  std::vector<ShaderCall> shaders;
  for (const ShaderInfo& info : ListShaders()) {
    if (info.stage != ShaderStage::kFragment) continue;
    ShaderCall call{info.name, {}};
    const bool named = std::any_of(info.parameters.begin(), info.parameters.end(),
                                   [](const auto& parameter) { return parameter.type == "string"; });
    if (named && mesh.attributes.empty()) continue;
    if (named) call.text["name"] = mesh.attributes.front().name;
    shaders.push_back(call);
  }
  return shaders;
}

ShaderCall RandomFragmentShader(Dice& dice, const std::vector<ShaderCall>& shaders) {
  ShaderCall call = dice.Of(shaders);
  if (call.name == "constant") call.parameters["value"] = {dice.Real(-2, 300), dice.Real(0, 1), -0.0};
  if (call.name == "uv") call.parameters["set"] = {double(dice.Below(2))};
  if (call.name == "checker") {
    call.parameters["size"] = {double(1 + dice.Below(9))};
    call.parameters["odd"] = {dice.Real(-1, 1)};
  }
  return call;
}

ShaderCall RandomVertexShader(Dice& dice, const TriangleMesh& mesh) {
  const bool animated = mesh.rig != nullptr && !mesh.rig->animations.empty();
  ShaderCall call{"identity", {}};
  switch (dice.Below(animated ? 8 : 5)) {
    case 0:
      call.name = "transform";
      call.parameters["matrix"] = {0.9, 0.1, 0, dice.Real(-1, 1), -0.1, 1.1, 0.05, 0.25, 0, 0.2, 0.8, 1, 0, 0, 0, 1};
      call.parameters["dt"] = {0.125};
      break;
    case 1:
      call.name = "displace_along_normal";
      call.parameters["distance"] = {dice.Real(-1, 1)};
      break;
    case 5:
    case 6:
    case 7:
      call.name = dice.OneIn(2) ? "skin" : "morph";
      call.parameters["animation"] = {double(dice.Below(mesh.rig->animations.size()))};
      call.parameters["time"] = {dice.Real(0, 2)};
      call.parameters["dt"] = {0.0625};
      break;
    default: break;
  }
  if (dice.OneIn(3)) {
    call.parameters["linear_velocity"] = {dice.Real(-3, 3), 1, 0};
    call.parameters["angular_velocity"] = {0, dice.Real(-3, 3), 0.5};
    call.parameters["center"] = {10, dice.Real(0, 20), 10};
  }
  return call;
}

TargetSpec RandomTarget(Dice& dice, const std::vector<ShaderCall>& shaders) {
  TargetSpec target;
  do {
    target.format = VoxelFormat(dice.Below(size_t(VoxelFormat::kF32) + 1));
    target.blend = Blend(dice.Below(size_t(Blend::kAnd) + 1));
  } while (!CheckBlend(target.format, target.blend).ok());
  target.components = target.format == VoxelFormat::kBit ? 1 : 1 + int(dice.Below(4));
  target.shader = RandomFragmentShader(dice, shaders);
  if (dice.OneIn(3)) target.clear = dice.Real(-3, 70'000);
  if (dice.OneIn(3)) target.fill_values = {dice.Real(-3, 300)};
  if (dice.OneIn(4)) target.quantum = dice.OneIn(2) ? 0x1p-8 : 0x1p-40;
  const bool integer = target.format != VoxelFormat::kBit && target.format < VoxelFormat::kF16;
  if (integer && dice.OneIn(3)) target.scale = dice.Real(-10, 1000);
  const bool bitwise = target.blend == Blend::kCount || target.blend == Blend::kAnd || target.blend == Blend::kOr;
  const std::string& name = target.shader.name;
  const bool colour = name == "base_color" || name == "emissive" || name == "color" || name == "constant";
  const bool encodes = !target.scale && !bitwise;
  if (target.format == VoxelFormat::kU8 && colour && encodes) target.encoding = Encoding::kSrgb;
  const bool narrow = target.format == VoxelFormat::kU8 || target.format == VoxelFormat::kU16;
  if (narrow && TakesSnorm(name) && encodes && !dice.OneIn(4)) target.encoding = Encoding::kSnorm;
  return target;
}

ParityCase RandomCase(Dice& dice, const TriangleMesh& mesh, const std::vector<GridRequest>& grids,
                      const std::vector<ShaderCall>& shaders) {
  ParityCase c;
  VoxelizeRequest& r = c.request;
  r.grid = dice.Of(grids);
  do {
    r.result = dice.Of(kKinds);
    r.coverage = dice.Of(kCoverages);
    r.fill = dice.OneIn(2) ? Fill::kNone : dice.Of(kFills);
  } while (!Valid(r.result, r.coverage, r.fill));
  r.layout = Layout(dice.Below(2));
  r.vertex_shader = RandomVertexShader(dice, mesh);
  const size_t targets = dice.OneIn(2) ? 1 : 1 + dice.Below(kMaxTargets);
  r.targets.clear();
  for (size_t i = 0; i < targets; ++i) r.targets.push_back(RandomTarget(dice, shaders));
  if (dice.OneIn(3)) c.slab_depth = 8 * int64_t(1 + dice.Below(3));
  c.streamed = dice.OneIn(4);
  return c;
}

void AddPlainBits(const std::vector<GridRequest>& grids, Dice& dice, std::vector<ParityCase>& cases) {
  const size_t first = dice.Below(grids.size());
  for (const ResultKind kind : kKinds) {
    for (const Coverage coverage : kCoverages) {
      for (const Fill fill : kFills) {
        if (!Valid(kind, coverage, fill)) continue;
        for (size_t i = 0; i < 3; ++i) {
          ParityCase c;
          // The whole mesh once, and two of the other grids in turn.
          c.request.grid = i == 0 ? grids[0] : grids[(first + cases.size()) % grids.size()];
          c.request.result = kind;
          c.request.coverage = coverage;
          c.request.fill = fill;
          if (i == 2) c.slab_depth = 8;
          cases.push_back(c);
        }
      }
    }
  }
}

// All formats and blends for each shader; then each alone, with 1 to 4 components.
void AddAllTargets(const std::vector<GridRequest>& grids, const std::vector<ShaderCall>& shaders, Dice& dice,
                   std::vector<ParityCase>& cases) {
  std::vector<TargetSpec> all, alone;
  for (const ShaderCall& shader : shaders) {
    for (int format = 0; format <= int(VoxelFormat::kF32); ++format) {
      for (int blend = 0; blend <= int(Blend::kAnd); ++blend) {
        if (!CheckBlend(VoxelFormat(format), Blend(blend)).ok()) continue;
        TargetSpec target;
        target.format = VoxelFormat(format);
        target.blend = Blend(blend);
        target.components = format == int(VoxelFormat::kBit) ? 1 : 1 + int(all.size() % 4);
        target.clear = double(all.size() % 3);
        target.shader = shader;
        all.push_back(target);
        if (shader.name != "color" && shader.name != "base_color" && shader.name != "occupancy") continue;
        for (int components = 1; components <= (format == int(VoxelFormat::kBit) ? 1 : 4); ++components) {
          target.components = components;
          alone.push_back(target);
        }
      }
    }
  }
  const auto add = [&](ResultKind kind, const std::vector<TargetSpec>& targets) {
    ParityCase c;
    c.request.grid = dice.OneIn(2) ? grids[0] : dice.Of(grids);
    c.request.result = kind;
    c.request.targets = targets;
    do {
      c.request.coverage = kCoverages[cases.size() % 4];
      c.request.fill = dice.Of(kFills);
      if (kind == ResultKind::kBuckets) c.request.fill = Fill::kNone;
      if (kind == ResultKind::kBuckets && c.request.coverage >= Coverage::kCenter) c.request.coverage = Coverage::kThin;
    } while (!Valid(kind, c.request.coverage, c.request.fill));
    c.request.layout = Layout(cases.size() / 3 % 2);
    cases.push_back(c);
  };
  for (const ResultKind kind : kKinds) {
    for (size_t i = 0; i < all.size(); i += kMaxTargets) {
      const auto begin = all.begin() + ptrdiff_t(i),
                 end = all.begin() + ptrdiff_t(std::min(i + kMaxTargets, all.size()));
      add(kind, {begin, end});
    }
    for (const TargetSpec& target : alone) add(kind, {target});
  }
}

std::string Numbers(const Vec3d& v) {
  return absl::StrCat(v.x, ",", v.y, ",", v.z);
}

std::string Describe(const ShaderCall& call) {
  std::string out = call.name;
  for (const auto& [name, values] : call.parameters) absl::StrAppend(&out, ":", name, "=", absl::StrJoin(values, ","));
  for (const auto& [name, value] : call.text) absl::StrAppend(&out, ":", name, "=", value);
  return out;
}

std::string Describe(const GridRequest& grid) {
  if (!grid.dims) {
    return absl::StrCat("resolution ", grid.resolution, grid.fit == GridFit::kCube ? " cube" : "", " padding ",
                        grid.padding);
  }
  const auto& d = *grid.dims;
  return absl::StrCat(d[0], "x", d[1], "x", d[2], " at ", Numbers(*grid.origin), " of ", Numbers(*grid.voxel_size));
}

std::string Word(std::string_view name) {
  return std::string(name);
}

}  // namespace

std::string Describe(const ParityCase& c) {
  const VoxelizeRequest& r = c.request;
  std::string out = absl::StrCat(Word(Name(r.result)), " ", Word(Name(r.coverage)), " fill=", Word(Name(r.fill)), " ",
                                 Describe(r.grid), r.layout == Layout::kPlanar ? " planar" : "");
  if (r.parts.scope != PartScope::kWhole) absl::StrAppend(&out, " parts=", Word(Name(r.parts.scope)));
  for (const PartRule& rule : r.parts.priorities) absl::StrAppend(&out, " '", rule.pattern, "'=", rule.number);
  if (c.slab_depth != 0) absl::StrAppend(&out, " slabs of ", c.slab_depth);
  if (c.streamed) absl::StrAppend(&out, " streamed");
  if (!(r.vertex_shader == ShaderCall{"identity", {}})) absl::StrAppend(&out, " | ", Describe(r.vertex_shader));
  for (const TargetSpec& t : r.targets) {
    absl::StrAppend(&out, " | ", Word(Name(t.format)), "x", t.components, " ", Word(Name(t.blend)), " ",
                    Describe(t.shader));
    if (t.clear != 0) absl::StrAppend(&out, " clear=", t.clear);
    if (!t.fill_values.empty()) absl::StrAppend(&out, " fill=", absl::StrJoin(t.fill_values, "/"));
    if (t.encoding != Encoding::kLinear) absl::StrAppend(&out, " ", Word(Name(t.encoding)));
    if (t.quantum != 0x1p-20) absl::StrAppend(&out, " quantum=", t.quantum);
    if (t.scale) absl::StrAppend(&out, " scale=", *t.scale);
  }
  return out;
}

std::vector<std::string> FeaturesOf(const ParityCase& c) {
  const VoxelizeRequest& r = c.request;
  std::vector<std::string> words = {Word(Name(r.result)),
                                    Word(Name(r.coverage)),
                                    absl::StrCat("fill=", Word(Name(r.fill))),
                                    absl::StrCat("parts=", Word(Name(r.parts.scope))),
                                    absl::StrCat("vertex:", r.vertex_shader.name),
                                    r.targets.size() == 1 ? "one target" : "several targets"};
  if (r.layout == Layout::kPlanar) words.push_back("planar");
  if (c.slab_depth != 0) words.push_back("slabs");
  if (c.streamed) words.push_back("streamed");
  for (const TargetSpec& t : r.targets) {
    words.push_back(absl::StrCat("format:", Word(Name(t.format))));
    words.push_back(absl::StrCat("blend:", Word(Name(t.blend))));
    words.push_back(absl::StrCat("shader:", t.shader.name));
    words.push_back(absl::StrCat("components:", t.components));
  }
  std::sort(words.begin(), words.end());
  words.erase(std::unique(words.begin(), words.end()), words.end());
  return words;
}

std::vector<ParityCase> CasesFor(const ParityMesh& named, const TriangleMesh& mesh, const CaseSizes& sizes,
                                 uint32_t seed) {
  Dice dice(seed);
  const std::vector<GridRequest> grids = named.extent > 0 ? GridsFor(named.extent) : FittedGrids();
  const std::vector<ShaderCall> shaders = FragmentShadersFor(mesh);
  std::vector<ParityCase> cases;
  if (sizes.plain_bits) AddPlainBits(grids, dice, cases);
  for (int i = 0; i < sizes.random; ++i) cases.push_back(RandomCase(dice, mesh, grids, shaders));
  if (sizes.all_targets) AddAllTargets(grids, shaders, dice, cases);
  return cases;
}

std::vector<ParityCase> PooledCases(const ParityMesh& named) {
  const std::vector<GridRequest> grids = GridsFor(named.extent);
  constexpr size_t kGrids[4] = {0, 6, 12, 13};
  std::vector<ParityCase> cases;
  for (size_t i = 0; i < 12; ++i) {
    ParityCase c;
    c.request.grid = grids[kGrids[i % 4]];
    c.request.result = ResultKind::kSparse;
    c.request.coverage = kCoverages[i % 3];
    TargetSpec& target = c.request.targets[0];
    target.format = i % 5 == 4 ? VoxelFormat::kF16 : VoxelFormat::kF32;
    target.blend = i % 2 == 0 ? Blend::kMax : Blend::kMin;
    target.shader = {i < 6 ? "triangle_id" : "geometric_normal", {}};
    c.slab_depth = i % 7 == 6 ? 8 : 0;
    cases.push_back(c);
  }
  return cases;
}

std::vector<ParityCase> LargestIdCases(const ParityMesh& named) {
  std::vector<ParityCase> cases;
  for (const GridRequest& grid : GridsFor(named.extent)) {
    const size_t i = cases.size();
    ParityCase c;
    c.request.grid = grid;
    c.request.coverage = kCoverages[i % 3];
    TargetSpec& target = c.request.targets[0];
    target.format = i % 2 == 0 ? VoxelFormat::kF32 : VoxelFormat::kU32;
    target.blend = Blend::kMax;
    target.shader = {"triangle_id", {}};
    c.slab_depth = i % 5 == 4 ? 8 : 0;
    cases.push_back(c);
  }
  return cases;
}

std::vector<ParityCase> SlabCases() {
  std::vector<ParityCase> cases;
  const auto add = [&](ResultKind kind, Fill fill, const char* shader, Blend blend, int components) -> ParityCase& {
    ParityCase c;
    c.request.grid = Placed({33, 16, 56}, {0, 0, 0}, {1.25, 2.5, 0.7});
    c.request.result = kind;
    c.request.coverage = kCoverages[cases.size() % 2];
    c.request.fill = fill;
    if (components > 0) {
      c.request.targets[0].format = VoxelFormat::kF32;
      c.request.targets[0].components = components;
      c.request.targets[0].blend = blend;
      c.request.targets[0].shader = {shader, {}};
    }
    cases.push_back(c);
    return cases.back();
  };
  add(ResultKind::kDense, Fill::kParity, "", Blend::kOr, 0);
  add(ResultKind::kDense, Fill::kFlood, "", Blend::kOr, 0);
  add(ResultKind::kDense, Fill::kNone, "triangle_id", Blend::kMax, 1);
  add(ResultKind::kDense, Fill::kParity, "geometric_normal", Blend::kAdd, 4).request.layout = Layout::kPlanar;
  // The memory that the device has is not enough for all layers.
  ParityCase& planar = add(ResultKind::kDense, Fill::kNone, "normal", Blend::kAverage, 4);
  planar.request.layout = Layout::kPlanar;
  planar.enough = 1 << 19;
  ParityCase& streamed = add(ResultKind::kDense, Fill::kFlood, "normal", Blend::kReplace, 4);
  streamed.streamed = true;
  streamed.enough = 1 << 19;
  add(ResultKind::kSparse, Fill::kNone, "", Blend::kOr, 0);
  add(ResultKind::kSparse, Fill::kParity, "triangle_id", Blend::kAdd, 4);
  add(ResultKind::kSparse, Fill::kNone, "normal", Blend::kMax, 4).enough = 1 << 19;
  add(ResultKind::kSparse, Fill::kNone, "triangle_id", Blend::kMax, 1);
  add(ResultKind::kBuckets, Fill::kNone, "normal", Blend::kMax, 4);
  return cases;
}

std::vector<ParityCase> VertexShaderCases(const ParityMesh& named, const TriangleMesh& mesh) {
  std::vector<ShaderCall> calls(5);
  calls[0] = {"identity", {}};
  calls[0].parameters["linear_velocity"] = {1, -2, 0.5};
  calls[1] = {"transform", {}};
  calls[1].parameters["matrix"] = {0.9, 0.1, 0, 2, -0.1, 1.1, 0.05, 0.25, 0, 0.2, -0.8, 31, 0, 0, 0, 1};  // mirrors
  calls[1].parameters["matrix_previous"] = {1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, -1, 30, 0, 0, 0, 1};
  calls[1].parameters["dt"] = {0.125};
  calls[2] = {"displace_along_normal", {}};
  calls[2].parameters["distance"] = {0.75};
  calls[3] = {"morph", {}};
  calls[4] = {"skin", {}};
  for (ShaderCall* call : {&calls[3], &calls[4]}) {
    call->parameters["animation"] = {0};
    call->parameters["time"] = {0.8};
    call->parameters["dt"] = {0.0625};
  }
  if (mesh.rig == nullptr) calls.resize(3);
  std::vector<TargetSpec> all;
  for (const char* shader : {"position", "normal", "tangent", "velocity"}) {
    all.emplace_back();
    all.back().format = VoxelFormat::kF32;
    all.back().components = 4;
    all.back().blend = Blend::kAdd;
    all.back().shader = {shader, {}};
  }
  std::vector<ParityCase> cases;
  for (const ShaderCall& call : calls) {
    for (const ResultKind kind : kKinds) {
      ParityCase c;
      const auto n = int64_t(named.extent / 2);
      c.request.grid = Placed({n, n, n}, {0, 0, 0}, {2, 2, 2});
      c.request.result = kind;
      c.request.coverage = kCoverages[cases.size() / 2 % 2];
      c.request.vertex_shader = call;
      cases.push_back(c);
      c.request.targets = all;
      cases.push_back(c);
    }
  }
  return cases;
}

}  // namespace voxelpipe::gpu

#include "oracle/parts/parts_reference.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>

#include "support/reference/fill_reference.h"
#include "support/reference/value_reference.h"
#include "support/run.h"

namespace voxelpipe::testing {
namespace {

double NumberOf(uint32_t stored, VoxelFormat format) {
  if (format == VoxelFormat::kF32) {
    float v;
    std::memcpy(&v, &stored, sizeof v);
    return v;
  }
  if (format == VoxelFormat::kF16) {
    const int exponent = int(stored >> 10 & 31), mantissa = int(stored & 1023);
    const double v = exponent == 0 ? std::ldexp(mantissa, -24) : std::ldexp(1024 + mantissa, exponent - 25);
    return (stored & 0x8000) != 0 ? -v : v;
  }
  return stored;
}

// Of stored values by ascending triangle id.
uint32_t Blended(const TargetSpec& spec, std::vector<uint32_t> v) {
  const auto less = [&](uint32_t a, uint32_t b) {
    const double x = NumberOf(a, spec.format), y = NumberOf(b, spec.format);
    return x < y || (x == y && std::signbit(x) > std::signbit(y));
  };
  uint32_t bits = spec.blend == Blend::kAnd ? UINT32_MAX : 0;
  double sum = 0;  // exact: of integers
  for (const uint32_t x : v) {
    bits = spec.blend == Blend::kAnd ? bits & x : bits | x;
    sum += x;
  }
  switch (spec.blend) {
    case Blend::kReplace: return v.back();
    case Blend::kFirst: return v.front();
    case Blend::kMin: return *std::min_element(v.begin(), v.end(), less);
    case Blend::kMax: return *std::max_element(v.begin(), v.end(), less);
    case Blend::kCount: return ReferenceNumber(double(v.size()), spec.format);
    case Blend::kAdd: return ReferenceNumber(sum, spec.format);
    default: return bits;
  }
}

bool ReadsMaterial(const std::string& shader) {
  return shader == "base_color" || shader == "emissive" || shader == "metallic_roughness";
}

bool HasMask(const Assembly& assembly) {
  return std::any_of(assembly.materials.begin(), assembly.materials.end(),
                     [](const Material& material) { return material.alpha_mode == AlphaMode::kMask; });
}

bool IsDiscarded(const Assembly& assembly, const TaggedBody& body, const std::string& shader) {
  if (body.material < 0 || !ReadsMaterial(shader)) return false;
  const Material& material = assembly.materials[size_t(body.material)];
  return material.alpha_mode == AlphaMode::kMask && material.base_color_factor.w < material.alpha_cutoff;
}

// What a shader gives all triangles of a body: nothing if it differs, or reads other things.
std::optional<FragmentOutput> GivenOfBody(const Assembly& assembly, const TaggedBody& body, const ReferencePart& part,
                                          const std::string& shader) {
  const Material none;
  const Material& material = body.material < 0 ? none : assembly.materials[size_t(body.material)];
  if (ReadsMaterial(shader) && body.colors) return std::nullopt;
  FragmentOutput out;
  out.discard = IsDiscarded(assembly, body, shader);
  if (shader == "label") {
    out.u[0] = part.label;
  } else if (shader == "material_id") {
    out.u[0] = body.material < 0 ? uint32_t(assembly.materials.size()) : uint32_t(body.material);
  } else if (shader == "mesh_id") {
    out.u[0] = body.mesh;
  } else if (shader == "base_color") {
    for (int c = 0; c < 4; ++c) out.f[c] = material.base_color_factor[c];
  } else if (shader == "emissive") {
    for (int c = 0; c < 3; ++c) out.f[c] = material.emissive_factor[c] * material.emissive_strength;
  } else if (shader == "metallic_roughness") {
    out.f[0] = material.metallic_factor;
    out.f[1] = material.roughness_factor;
  } else {
    return std::nullopt;
  }
  return out;
}

std::optional<FragmentOutput> GivenOfPart(const Assembly& assembly, const ReferencePart& part,
                                          const std::string& shader) {
  std::optional<FragmentOutput> common;
  for (const size_t b : part.bodies) {
    const auto of_body = GivenOfBody(assembly, assembly.bodies[b], part, shader);
    if (!of_body) return std::nullopt;
    if (common && (common->discard != of_body->discard || std::memcmp(common->f, of_body->f, sizeof common->f) != 0 ||
                   std::memcmp(common->u, of_body->u, sizeof common->u) != 0)) {
      return std::nullopt;
    }
    common = of_body;
  }
  return common;
}

// The velocity of a file's motion at a voxel's centre.
FragmentOutput VelocityAt(const std::optional<RigidMotionNumbers>& motion, const GridSpec& grid,
                          const std::array<int64_t, 3>& at) {
  FragmentOutput out;
  if (!motion) return out;
  Vec3d r;
  for (int a = 0; a < 3; ++a) {
    r[a] = grid.origin[a] + (double(at[size_t(a)]) + .5) * grid.voxel_size[a] - motion->center[a];
  }
  const Vec3d &w = motion->angular, turn{w.y * r.z - w.z * r.y, w.z * r.x - w.x * r.z, w.x * r.y - w.y * r.x};
  for (int a = 0; a < 3; ++a) out.f[a] = float(motion->linear[a] + turn[a]);
  return out;
}

// The arrays of a dense or sparse result, by voxel.
class Values {
 public:
  explicit Values(const VoxelizeResult& result) : result_(result), count_(result.grid.voxels()) {
    if (result.kind != ResultKind::kSparse) return;
    const auto& dims = result.grid.dims;
    const int64_t wide = (dims[0] + 7) / 8, high = (dims[1] + 7) / 8;
    places_.assign(count_, kAbsent);
    count_ = 0;
    for (uint64_t b = 0; b < result.bricks.size() / 8; ++b) {
      const auto id = int64_t(ValueAt<uint64_t>(result.bricks, b));
      for (int bit = 0; bit < 512; ++bit) {
        if ((result.masks.data()[b * 64 + uint64_t(bit) / 8] >> (bit % 8) & 1) == 0) continue;
        const int64_t x = id % wide * 8 + bit % 8, y = id / wide % high * 8 + bit / 8 % 8,
                      z = id / wide / high * 8 + bit / 64;
        places_.at(uint64_t(x + dims[0] * (y + dims[1] * z))) = count_++;
      }
    }
  }
  bool sparse() const { return !places_.empty(); }
  bool Listed(uint64_t voxel) const { return places_.empty() || places_[voxel] != kAbsent; }
  uint32_t At(size_t target, uint64_t voxel, int c) const {
    const TargetSpec& spec = result_.specs[target];
    const uint64_t n = places_.empty() ? voxel : places_[voxel];
    const uint64_t i =
        result_.layout == Layout::kPlanar ? uint64_t(c) * count_ + n : n * uint64_t(spec.components) + uint64_t(c);
    return StoredAt(result_.targets[target], spec.format, i);
  }

 private:
  static constexpr uint64_t kAbsent = UINT64_MAX;
  const VoxelizeResult& result_;
  uint64_t count_;
  std::vector<uint64_t> places_;
};

// What is to be in one voxel.
struct Expected {
  std::optional<size_t> owner, inside_owner;  // of all, and of those that contain the centre
  bool decided = true, covered = false, inside = false;
};

class Comparison {
 public:
  Comparison(const Assembly& assembly, const Solids& solids, const Fragments& fragments, const VoxelizeRequest& request,
             const GridSpec& grid)
      : assembly_(assembly), fragments_(fragments), request_(request), grid_(grid) {
    cut_ = CutParts(assembly, request.parts);
    masked_ = HasMask(assembly);
    for (const FileOf& file : assembly.files) moves_ = moves_ || file.motion.has_value();
    for (const ReferencePart& part : cut_.parts) inside_.push_back(solids.Of(part.bodies, request.fill));
    for (size_t b = 0; b < assembly.bodies.size(); ++b) {
      part_of_.insert(part_of_.end(), assembly.bodies[b].body.triangles.size(), cut_.of_body[b]);
      body_of_.insert(body_of_.end(), assembly.bodies[b].body.triangles.size(), b);
    }
    for (const TargetSpec& spec : request.targets) {
      replacing_.push_back(spec);
      replacing_.back().blend = Blend::kReplace;
      auto& discarded = discarded_.emplace_back();
      for (const TaggedBody& body : assembly.bodies) {
        discarded.push_back(IsDiscarded(assembly, body, spec.shader.name));
      }
      auto& given = given_.emplace_back();
      for (const ReferencePart& part : cut_.parts) {
        given.push_back(request.parts.scope == PartScope::kWhole ? std::nullopt
                                                                 : GivenOfPart(assembly, part, spec.shader.name));
      }
    }
  }

  Expected Of(uint64_t n) const {
    Expected e;
    e.covered = !fragments_.Of(n).empty();
    const auto propose = [&](size_t part) {
      if (!e.owner || cut_.parts[part].rank > cut_.parts[*e.owner].rank) e.owner = part;
    };
    for (const uint32_t t : fragments_.Of(n)) propose(part_of_[t]);
    for (size_t part = 0; part < inside_.size(); ++part) {
      if (inside_[part][n] != Inside::kYes) continue;
      propose(part);
      e.inside = true;
      if (!e.inside_owner || cut_.parts[part].rank > cut_.parts[*e.inside_owner].rank) e.inside_owner = part;
    }
    for (size_t part = 0; part < inside_.size(); ++part) {
      if (inside_[part][n] != Inside::kUnsure) continue;
      // Where a mask discards fragments of the owner, parts below it may matter, too.
      if (masked_ || !e.owner || cut_.parts[part].rank > cut_.parts[*e.owner].rank) e.decided = false;
    }
    return e;
  }

  // What the voxel may hold. The definition leaves open whether fragments that a mask discards in this target, but not
  // in another one, count for this one: then there are two values.
  std::vector<uint32_t> ValuesOf(const Expected& e, uint64_t n, size_t target, int c) const {
    const uint32_t clear = ReferenceNumber(request_.targets[target].clear, request_.targets[target].format);
    if (!e.owner) return {clear};
    std::vector<size_t> kept;
    std::optional<size_t> owner = e.inside_owner;  // by what is kept
    bool owners_are_kept = true;
    for (size_t i = 0; i < fragments_.Of(n).size(); ++i) {
      const uint32_t triangle = fragments_.Of(n)[i];
      if (discarded_[target][body_of_[triangle]]) {
        owners_are_kept = owners_are_kept && part_of_[triangle] != *e.owner;
        continue;
      }
      kept.push_back(i);
      if (!owner || cut_.parts[part_of_[triangle]].rank > cut_.parts[*owner].rank) owner = part_of_[triangle];
    }
    const bool all = kept.size() == fragments_.Of(n).size();
    const bool counts = request_.targets[target].blend == Blend::kReplace ? owners_are_kept : all;
    const auto blended = BlendedOf(*e.owner, kept, n, target, c);
    std::vector<uint32_t> values = {blended ? *blended : counts ? FillOf(*e.owner, n, target, c) : clear};
    if (all) return values;
    if (!owner) return {values[0], clear};
    const auto of_kept = BlendedOf(*owner, kept, n, target, c);
    values.push_back(of_kept ? *of_kept : FillOf(*owner, n, target, c));
    return values;
  }

  std::string Describe(uint64_t n) const {
    std::string text = "fragments (triangle:part)";
    for (const uint32_t t : fragments_.Of(n)) text += " " + std::to_string(t) + ":" + std::to_string(part_of_[t]);
    text += ", inside";
    for (size_t part = 0; part < inside_.size(); ++part) {
      if (inside_[part][n] == Inside::kNo) continue;
      text += " " + std::to_string(part) + (inside_[part][n] == Inside::kUnsure ? "?" : "");
    }
    return text;
  }

 private:
  // In: the fragments of the voxel that the target's shader does not discard. Nothing if none of them counts.
  std::optional<uint32_t> BlendedOf(size_t owner, const std::vector<size_t>& kept, uint64_t n, size_t target,
                                    int c) const {
    const TargetSpec& spec = request_.targets[target];
    std::vector<uint32_t> values;
    for (const size_t i : kept) {
      const size_t part = part_of_[fragments_.Of(n)[i]];
      if (spec.blend == Blend::kReplace && part != owner) continue;
      values.push_back(spec.shader.name == "label" ? ReferenceNumber(c == 0 ? cut_.parts[part].label : 0, spec.format)
                                                   : fragments_.Value(n, i, target, c));
    }
    if (values.empty()) return std::nullopt;
    return Blended(spec, values);
  }

  uint32_t FillOf(size_t owner, uint64_t n, size_t target, int c) const {
    const TargetSpec& spec = request_.targets[target];
    const auto nx = uint64_t(grid_.dims[0]), ny = uint64_t(grid_.dims[1]);
    const std::array<int64_t, 3> at = {int64_t(n % nx), int64_t(n / nx % ny), int64_t(n / nx / ny)};
    const bool by_default = spec.fill_values.empty() && spec.format != VoxelFormat::kBit && spec.blend != Blend::kCount;
    if (by_default && moves_ && spec.shader.name == "velocity") {
      if (request_.parts.scope != PartScope::kFile) return ReferenceNumber(spec.clear, spec.format);
      const FileOf& file = assembly_.files[assembly_.bodies[cut_.parts[owner].bodies[0]].file];
      return ReferenceBlend(replacing_[target], {VelocityAt(file.motion, grid_, at)}, c);
    }
    const std::optional<FragmentOutput>& given = given_[target][owner];
    if (!by_default || !given) return ReferenceFill(request_, target, grid_, at[0], at[1], at[2], c);
    if (given->discard) return ReferenceNumber(spec.clear, spec.format);
    if (spec.shader.name == "label") return ReferenceNumber(c == 0 ? given->u[0] : 0, spec.format);
    return ReferenceBlend(replacing_[target], {*given}, c);
  }

  const Assembly& assembly_;
  const Fragments& fragments_;
  const VoxelizeRequest& request_;
  const GridSpec& grid_;
  ReferenceParts cut_;
  bool moves_ = false, masked_ = false;
  std::vector<TargetSpec> replacing_;
  std::vector<std::vector<bool>> discarded_;                       // [target][body]
  std::vector<size_t> part_of_, body_of_;                          // of triangles
  std::vector<std::vector<Inside>> inside_;                        // [part][voxel]
  std::vector<std::vector<std::optional<FragmentOutput>>> given_;  // [target][part]
};

}  // namespace

Fragments::Fragments(const Assembly& assembly, const VoxelizeRequest& request) : request_(request) {
  VoxelizeRequest all = request;
  all.result = ResultKind::kBuckets;
  all.fill = Fill::kNone;
  all.parts = {};
  // The pairs of `none` and `center` are among those of `conservative`, with the same values.
  if (request.coverage == Coverage::kNone || request.coverage == Coverage::kCenter) {
    all.coverage = Coverage::kConservative;
  }
  buckets_ = RunPipeline(assembly.mesh, all);
  triangles_.resize(buckets_.grid.voxels());
  places_.resize(triangles_.size());
  if (request.coverage == Coverage::kNone) return;
  std::vector<std::vector<uint32_t>> center;
  if (request.coverage == Coverage::kCenter) {
    TriangleMesh indexed = assembly.mesh;
    for (Vec3d& p : indexed.positions) p = WorldToIndex(buckets_.grid.index_space(), p);
    center = FragmentLists(indexed, buckets_.grid.dims, Coverage::kCenter);
  }
  for (uint64_t i = 0; i < buckets_.voxels.size() / sizeof(uint64_t); ++i) {
    const auto voxel = ValueAt<uint64_t>(buckets_.voxels, i);
    for (auto at = ValueAt<uint64_t>(buckets_.offsets, i); at < ValueAt<uint64_t>(buckets_.offsets, i + 1); ++at) {
      const auto triangle = ValueAt<uint32_t>(buckets_.triangles, at);
      if (!center.empty() && !std::binary_search(center[voxel].begin(), center[voxel].end(), triangle)) continue;
      triangles_[voxel].push_back(triangle);
      places_[voxel].push_back(at);
    }
  }
}

uint32_t Fragments::Value(uint64_t voxel, size_t i, size_t target, int c) const {
  const TargetSpec& spec = request_.targets[target];
  const uint64_t at = places_[voxel][i];
  const uint64_t place = request_.layout == Layout::kPlanar ? uint64_t(c) * buckets_.listed_fragments() + at
                                                            : at * uint64_t(spec.components) + uint64_t(c);
  return StoredAt(buckets_.targets[target], spec.format, place);
}

namespace {

// In: of each part the voxels that it owns as far as is decided, and the number of the others.
void ExpectTable(const Assembly& assembly, const ReferenceParts& cut, const PartTable& table,
                 const std::vector<uint64_t>& owned, uint64_t undecided, const std::string& what) {
  ASSERT_EQ(table.size(), cut.parts.size()) << what;
  for (size_t p = 0; p < cut.parts.size(); ++p) {
    const ReferencePart& part = cut.parts[p];
    uint64_t triangles = 0;
    bool closed = true;
    for (const size_t b : part.bodies) {
      triangles += assembly.bodies[b].body.triangles.size();
      closed = closed && assembly.bodies[b].body.closed;
    }
    EXPECT_EQ(table.label[p], part.label) << what << ", part " << p;
    EXPECT_EQ(table.priority[p], part.priority) << what << ", part " << p;
    EXPECT_EQ(table.Name(p), part.name) << what << ", part " << p;
    EXPECT_EQ(table.triangles[p], triangles) << what << ", part " << p;
    if (closed) {
      EXPECT_EQ(table.open_edges[p], 0u) << what << ", part " << p;
      EXPECT_EQ(table.odd_columns[p], 0u) << what << ", part " << p;
    }
    if (HasMask(assembly)) continue;  // the lists of fragments lack those that every target discards
    EXPECT_GE(table.voxels[p], owned[p]) << what << ", part " << p;
    EXPECT_LE(table.voxels[p], owned[p] + undecided) << what << ", part " << p;
  }
}

}  // namespace

double ExpectByParts(const Assembly& assembly, const Solids& solids, const Fragments& fragments,
                     const VoxelizeRequest& request, const GridSpec& grid, const std::string& what) {
  const VoxelizeResult result = RunPipeline(assembly.mesh, request);
  EXPECT_EQ(result.grid, grid) << what;
  if (!(result.grid == grid)) return 0;
  const Comparison comparison(assembly, solids, fragments, request, grid);
  const Values values(result);
  const ReferenceParts cut = CutParts(assembly, request.parts);
  std::vector<uint64_t> owned(cut.parts.size());
  uint64_t wrong = 0, decided = 0, occupied = 0;
  for (uint64_t n = 0; n < grid.voxels(); ++n) {
    const Expected e = comparison.Of(n);
    if (!e.decided) continue;
    ++decided;
    occupied += e.covered || e.inside;
    if (e.owner) ++owned[*e.owner];
    const auto fail = [&](const std::string& message) {
      if (++wrong <= 2) ADD_FAILURE() << what << ": voxel " << n << " " << message << "; " << comparison.Describe(n);
    };
    if (values.sparse()) {
      if (values.Listed(n) != (e.covered || e.inside)) fail(values.Listed(n) ? "is listed" : "is not listed");
      if (!values.Listed(n)) continue;
    }
    for (size_t t = 0; t < request.targets.size(); ++t) {
      for (int c = 0; c < request.targets[t].components; ++c) {
        const uint32_t got = values.At(t, n, c);
        const std::vector<uint32_t> want = comparison.ValuesOf(e, n, t, c);
        if (std::find(want.begin(), want.end(), got) != want.end()) continue;
        const TargetSpec& spec = request.targets[t];
        fail("target " + std::to_string(t) + " (" + std::string(Name(spec.format)) + ":" +
             std::string(Name(spec.blend)) + ":" + spec.shader.name + ") component " + std::to_string(c) + " holds " +
             std::to_string(got) + ", not " + std::to_string(want[0]));
        break;
      }
    }
  }
  EXPECT_EQ(wrong, 0u) << what;
  if (request.parts.scope == PartScope::kWhole) {
    EXPECT_TRUE(result.parts.empty()) << what;
  } else {
    ExpectTable(assembly, cut, result.parts, owned, grid.voxels() - decided, what);
  }
  EXPECT_GE(result.stats.occupied, occupied) << what;
  EXPECT_LE(result.stats.occupied, occupied + grid.voxels() - decided) << what;
  uint64_t pairs = 0;
  for (uint64_t n = 0; n < grid.voxels(); ++n) pairs += fragments.Of(n).size();
  if (!HasMask(assembly) && result.stats.fragments) {
    EXPECT_EQ(*result.stats.fragments, pairs) << what;
  }
  const bool closed = std::all_of(assembly.bodies.begin(), assembly.bodies.end(),
                                  [](const TaggedBody& tagged) { return tagged.body.closed; });
  if (closed) {
    EXPECT_EQ(result.stats.odd_columns, 0u) << what;
  }
  return double(decided) / double(grid.voxels());
}

uint32_t StoredAt(const HostBuffer& values, VoxelFormat format, uint64_t i) {
  switch (format) {
    case VoxelFormat::kBit: return BitAt(values, i);
    case VoxelFormat::kU8: return values.data()[i];
    case VoxelFormat::kU16:
    case VoxelFormat::kF16: return ValueAt<uint16_t>(values, i);
    default: return ValueAt<uint32_t>(values, i);
  }
}

}  // namespace voxelpipe::testing

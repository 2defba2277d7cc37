#include "load/gltf/geometry/gltf_primitives.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "base/limit_error.h"
#include "load/gltf/document/gltf_model.h"
#include "load/gltf/document/json_guard.h"
#include "load/gltf/geometry/gltf_attributes.h"
#include "load/gltf/geometry/gltf_topology.h"
#include "mesh/scene/scene_bytes.h"

namespace voxelpipe::gltf {
namespace {

// Prepends the location to an error of an inner part.
absl::Status At(const std::string& where, const absl::Status& status) {
  return WithText(status, absl::StrCat("glTF: ", where, ": ", absl::StripPrefix(status.message(), "glTF: ")));
}

// Tests exponents without branches: there are many values, and almost all are finite.
bool AllFinite(const float* values, size_t count) {
  uint32_t odd = 0;
  for (size_t i = 0; i < count; ++i) {
    uint32_t bits;
    std::memcpy(&bits, values + i, sizeof bits);
    odd |= (bits & 0x7f800000u) == 0x7f800000u ? 1u : 0u;
  }
  return odd == 0;
}

// Calls step(begin, end) for the parts of [0, count), until one fails or the job ended.
template <typename Step>
absl::Status InSteps(const JobContext& job, size_t count, Step step) {
  constexpr size_t kElementsAStep = 1 << 16;
  for (size_t begin = 0; begin < count; begin += kElementsAStep) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    if (absl::Status bad = step(begin, std::min(count, begin + kElementsAStep)); !bad.ok()) return bad;
  }
  return absl::OkStatus();
}

// Reads the optional attributes of one primitive; all must have as many values as there are positions.
class Filler {
 public:
  Filler(AttributeSource& source, Primitive& out, const std::string& where, PrimitiveContext& context)
      : source_(source), out_(out), where_(where), context_(context) {}

  // Values of `name` if it has one of the allowed numbers of components. A wrong number drops the attribute with a
  // warning, a wrong count is an error. Values that are not finite become 0 with a warning.
  absl::StatusOr<std::optional<AttributeValues>> Values(const std::string& name, int least, int most) {
    absl::StatusOr<std::optional<AttributeValues>> found = source_.Find(name);
    if (!found.ok()) return At(where_, found.status());
    if (!*found) return std::nullopt;
    AttributeValues& data = **found;
    if (data.components < least || data.components > most) {
      Warn(absl::StrCat(name, " (", data.origin, ") has ", data.components, " components and is ignored"));
      return std::nullopt;
    }
    const uint64_t count = data.values.size() / data.components;
    if (count != out_.positions.size()) return WrongCount(name, data.origin, count);
    if (absl::Status over = Clean(data.values.data(), data.values.size(), name, data.origin); !over.ok()) return over;
    return found;
  }

  absl::Status Fill() {
    if (absl::Status bad = Vectors<Vec3f>("NORMAL", out_.normals); !bad.ok()) return bad;
    if (absl::Status bad = Vectors<Vec4f>("TANGENT", out_.tangents); !bad.ok()) return bad;
    for (int set = 0; set < 2; ++set) {
      if (absl::Status bad = Vectors<Vec2f>(absl::StrCat("TEXCOORD_", set), out_.uv[set]); !bad.ok()) return bad;
      if (absl::Status bad = Joints(set); !bad.ok()) return bad;
    }
    if (absl::Status bad = Colors(); !bad.ok()) return bad;
    return Own();
  }

 private:
  const JobContext& job() const { return context_.budget.job(); }

  // Sets values that are not finite to 0, with a warning if there are any.
  absl::Status Clean(float* values, size_t count, const std::string& name, const std::string& origin) {
    bool any = false;
    absl::Status over = InSteps(job(), count, [&](size_t begin, size_t end) {
      if (AllFinite(values + begin, end - begin)) return absl::OkStatus();
      any = true;
      for (size_t i = begin; i < end; ++i) {
        if (!std::isfinite(values[i])) values[i] = 0;
      }
      return absl::OkStatus();
    });
    if (any) Warn(absl::StrCat(name, " (", origin, ") has values that are not finite; they count as 0"));
    return over;
  }

  absl::Status WrongCount(const std::string& name, const std::string& origin, uint64_t count) const {
    return absl::InvalidArgumentError(absl::StrCat("glTF: ", where_, ": ", name, " (", origin, ") has ", count,
                                                   " elements, POSITION has ", out_.positions.size()));
  }
  void Warn(const std::string& what) { context_.warnings.Add(WarningCode::kNonconformingFile, where_, what); }

  // Like Values, for vectors of exactly V's components.
  template <typename V>
  absl::Status Vectors(const std::string& name, std::vector<V>& out) {
    absl::StatusOr<std::optional<AttributeVectors<V>>> found = source_.FindVectors<V>(name);
    if (!found.ok()) return At(where_, found.status());
    if (!*found) return absl::OkStatus();
    AttributeVectors<V>& data = **found;
    if (data.components != static_cast<int>(sizeof(V) / sizeof(float))) {
      Warn(absl::StrCat(name, " (", data.origin, ") has ", data.components, " components and is ignored"));
      return absl::OkStatus();
    }
    if (data.values.size() != out_.positions.size()) return WrongCount(name, data.origin, data.values.size());
    out = std::move(data.values);
    return Clean(reinterpret_cast<float*>(out.data()), out.size() * (sizeof(V) / sizeof(float)), name, data.origin);
  }

  absl::Status Colors() {
    absl::StatusOr<std::optional<AttributeValues>> data = Values("COLOR_0", 3, 4);
    if (!data.ok()) return data.status();
    if (!*data) return absl::OkStatus();
    const int n = (*data)->components;
    const std::vector<float>& values = (*data)->values;
    const size_t count = values.size() / size_t(n);
    if (absl::Status full = context_.budget.Take(count, sizeof(Vec4f), where_); !full.ok()) return full;
    out_.colors.reserve(count);
    return InSteps(job(), count, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        out_.colors.push_back({values[i * n], values[i * n + 1], values[i * n + 2], n == 4 ? values[i * n + 3] : 1.0f});
      }
      return absl::OkStatus();
    });
  }

  // Application-specific attributes.
  absl::Status Own() {
    for (const std::string& name : source_.OwnNames()) {
      absl::StatusOr<std::optional<AttributeValues>> data = Values(name, 1, 4);
      if (!data.ok()) return data.status();
      if (*data) out_.attributes.push_back({name, (*data)->components, std::move((*data)->values)});
    }
    return absl::OkStatus();
  }

  // A joint of weight 0 counts as joint 0, so that every stored joint index is valid.
  absl::Status Joints(int set) {
    absl::StatusOr<std::optional<AttributeValues>> joints = Values(absl::StrCat("JOINTS_", set), 4, 4);
    if (!joints.ok()) return joints.status();
    absl::StatusOr<std::optional<AttributeValues>> weights = Values(absl::StrCat("WEIGHTS_", set), 4, 4);
    if (!weights.ok()) return weights.status();
    if (joints->has_value() != weights->has_value()) {
      Warn(absl::StrCat(*joints ? "JOINTS_" : "WEIGHTS_", set, " has no ", *joints ? "WEIGHTS_" : "JOINTS_", set,
                        " and is ignored"));
    }
    if (!*joints || !*weights) return absl::OkStatus();
    constexpr uint64_t kBytes = sizeof(out_.joints[0][0]) + sizeof(out_.weights[0][0]);
    if (absl::Status full = context_.budget.Take(out_.positions.size(), kBytes, where_); !full.ok()) return full;
    out_.joints[set].reserve(out_.positions.size());
    out_.weights[set].reserve(out_.positions.size());
    return InSteps(job(), out_.positions.size(), [&](size_t begin, size_t end) {
      out_.joints[set].resize(end);
      out_.weights[set].resize(end);
      for (size_t i = begin; i < end; ++i) {
        for (size_t c = 0; c < 4; ++c) {
          const float joint = (*joints)->values[4 * i + c], weight = (*weights)->values[4 * i + c];
          if (joint < 0 || joint > 65535) {
            return absl::InvalidArgumentError(absl::StrCat("glTF: ", where_, ": JOINTS_", set, " (", (*joints)->origin,
                                                           "), vertex ", i, ": no joint index"));
          }
          out_.joints[set][i][c] = weight == 0 ? uint16_t{0} : static_cast<uint16_t>(joint);
          out_.weights[set][i][c] = weight;
        }
      }
      return absl::OkStatus();
    });
  }

  AttributeSource& source_;
  Primitive& out_;
  const std::string& where_;
  PrimitiveContext& context_;
};

absl::Status CheckFinite(const JobContext& job, const Primitive& out, const std::string& origin,
                         const std::string& where) {
  return InSteps(job, out.positions.size(), [&](size_t begin, size_t end) {
    if (AllFinite(&out.positions[begin].x, 3 * (end - begin))) return absl::OkStatus();
    while (std::isfinite(out.positions[begin].x) && std::isfinite(out.positions[begin].y) &&
           std::isfinite(out.positions[begin].z)) {
      ++begin;
    }
    return absl::InvalidArgumentError(
        absl::StrCat("glTF: ", where, ": POSITION (", origin, "), vertex ", begin, " is not finite"));
  });
}

// Adds weight * displacement, each sum rounded to float (as mesh/scene/vertex_pose.h does).
template <typename V>
absl::Status AddScaled(const JobContext& job, std::vector<V>& to, const std::vector<Vec3f>& delta, double weight) {
  return InSteps(job, delta.size(), [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      for (int c = 0; c < 3; ++c) to[i][c] = static_cast<float>(to[i][c] + weight * delta[i][c]);
    }
    return absl::OkStatus();
  });
}

// Displacements of one target.
absl::Status ReadTarget(const std::map<std::string, int>& attributes, const std::string& where, Primitive& out,
                        PrimitiveContext& context, MorphTarget& target) {
  AttributeSource source(attributes, {}, std::nullopt, context);
  Filler filler(source, out, where, context);
  const auto read = [&](const char* name, std::vector<Vec3f>& to) {
    absl::StatusOr<std::optional<AttributeValues>> delta = filler.Values(name, 3, 3);
    if (!delta.ok()) return delta.status();
    if (!*delta) return absl::OkStatus();
    const std::vector<float>& values = (*delta)->values;
    if (absl::Status full = context.budget.Take(values.size(), sizeof(float), where); !full.ok()) return full;
    to.reserve(values.size() / 3);
    return InSteps(context.budget.job(), values.size() / 3, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) to.push_back({values[3 * i], values[3 * i + 1], values[3 * i + 2]});
      return absl::OkStatus();
    });
  };
  if (absl::Status bad = read("POSITION", target.positions); !bad.ok()) return bad;
  if (!out.normals.empty()) {
    if (absl::Status bad = read("NORMAL", target.normals); !bad.ok()) return bad;
  }
  return out.tangents.empty() ? absl::OkStatus() : read("TANGENT", target.tangents);
}

// Reads the morph targets and applies them at their default weights: value + sum of weight * displacement. A fault of a
// target with default weight 0 is stored with the target.
absl::Status Morph(const tinygltf::Primitive& primitive, const std::vector<double>& weights, const std::string& where,
                   Primitive& out, PrimitiveContext& context) {
  if (primitive.targets.empty()) return absl::OkStatus();
  auto morph = std::make_shared<MorphData>();
  Budget& budget = context.budget;
  if (absl::Status full = budget.Take(out.positions.size(), 40, where); !full.ok()) return full;
  if (absl::Status full = budget.Take(primitive.targets.size(), sizeof(MorphTarget), where); !full.ok()) return full;
  morph->targets.reserve(primitive.targets.size());
  morph->positions = out.positions;
  morph->normals = out.normals;
  morph->tangents = out.tangents;
  for (size_t i = 0; i < primitive.targets.size(); ++i) {
    if (absl::Status over = budget.job().Check(); !over.ok()) return over;
    const double weight = i < weights.size() ? weights[i] : 0.0;
    const uint64_t before = budget.bytes();
    MorphTarget& target = morph->targets.emplace_back();
    absl::Status fault =
        ReadTarget(primitive.targets[i], absl::StrCat(where, ", morph target ", i), out, context, target);
    if (!fault.ok() && (weight != 0 || !IsOfFile(fault))) return fault;
    if (!fault.ok()) {
      target = MorphTarget{};
      budget.ShrinkTo(before);
      if (absl::Status full = budget.Take(FaultBytes(fault), 1, where); !full.ok()) return full;
      target.fault = std::move(fault);
    }
    const uint64_t moved = target.positions.size() + target.normals.size() + target.tangents.size();
    budget.ShrinkTo(before + FaultBytes(target.fault) + moved * sizeof(Vec3f));  // its input is freed
    if (weight == 0) continue;
    if (absl::Status bad = AddScaled(budget.job(), out.positions, target.positions, weight); !bad.ok()) return bad;
    if (absl::Status bad = AddScaled(budget.job(), out.normals, target.normals, weight); !bad.ok()) return bad;
    if (absl::Status bad = AddScaled(budget.job(), out.tangents, target.tangents, weight); !bad.ok()) return bad;
  }
  out.morph = std::move(morph);
  return absl::OkStatus();
}

constexpr char kDracoExtension[] = "KHR_draco_mesh_compression";

// The Draco extension of a primitive: its stream decoded, and the names it gives to the stream's attributes.
struct DracoPart {
  std::optional<DracoMesh> mesh;
  std::map<std::string, uint32_t> ids;
};

absl::StatusOr<DracoPart> ReadDraco(const tinygltf::Primitive& primitive, const std::string& where,
                                    PrimitiveContext& context) {
  DracoPart part;
  const absl::StatusOr<std::optional<std::span<const uint8_t>>> bytes = DracoStream(primitive, where, context);
  if (!bytes.ok()) return bytes.status();
  if (!*bytes) return part;
  const tinygltf::Value& extension = primitive.extensions.at(kDracoExtension);
  const tinygltf::Value& ids = extension.Get("attributes");
  for (const std::string& name : ids.Keys()) part.ids[name] = static_cast<uint32_t>(ids.Get(name).GetNumberAsInt());
  absl::StatusOr<DracoMesh> mesh = context.draco->Take(**bytes);
  if (!mesh.ok()) {
    return At(absl::StrCat(where, ", bufferView ", extension.Get("bufferView").GetNumberAsInt()), mesh.status());
  }
  part.mesh = *std::move(mesh);
  return part;
}

// Draco has no checksum: counts that differ from the accessors' are the only sign of a wrong stream. Old exporters
// write such files, though, and all viewers show them, so the counts of the stream are used.
void CompareCounts(const tinygltf::Primitive& primitive, const DracoMesh& mesh, const std::string& where,
                   const PrimitiveContext& context) {
  const auto compare = [&](int accessor, uint64_t decoded, const char* what) {
    if (accessor < 0) return;
    const uint64_t declared = context.accessors.decl(static_cast<uint32_t>(accessor)).count;
    if (declared == decoded) return;
    context.warnings.Add(WarningCode::kCountMismatch, where,
                         absl::StrCat("accessor ", accessor, " declares ", declared, " ", what,
                                      ", the Draco stream has ", decoded, "; the stream's count holds"));
  };
  compare(primitive.indices, 3 * mesh.triangles.size(), "indices");
  const auto position = primitive.attributes.find("POSITION");
  if (position != primitive.attributes.end()) compare(position->second, mesh.points, "vertices");
}

// Joints beyond the first eight of a vertex are not read, so the first eight would have too much weight.
void WarnOfJointSets(const tinygltf::Primitive& primitive, const std::string& where, PrimitiveContext& context) {
  for (const auto& [name, accessor] : primitive.attributes) {
    if (!absl::StartsWith(name, "JOINTS_") || name == "JOINTS_0" || name == "JOINTS_1") continue;
    context.warnings.Add(WarningCode::kNonconformingFile, where,
                         absl::StrCat(Quoted(name), " is not read: vertices follow their first eight joints"));
  }
}

// The indices, or the positions one after the other, as triangles.
absl::Status ReadTriangles(const tinygltf::Primitive& primitive, const std::string& where, Primitive& out,
                           PrimitiveContext& context) {
  std::optional<std::vector<uint32_t>> indices;
  std::string index_name = where;
  if (primitive.indices >= 0) {
    const uint32_t accessor = static_cast<uint32_t>(primitive.indices);
    const AccessorDecl& decl = context.accessors.decl(accessor);
    index_name = absl::StrCat(where, ": accessor ", accessor);
    if (primitive.mode == kTriangles && decl.components == 1 && decl.count % 3 == 0) {  // plain triangles
      absl::StatusOr<std::vector<std::array<uint32_t, 3>>> triangles = context.accessors.Triples(accessor);
      if (!triangles.ok()) return At(where, triangles.status());
      out.triangles = *std::move(triangles);
      return CheckTriangles(out.triangles, out.positions.size(), index_name, context.budget);
    }
    absl::StatusOr<std::vector<uint32_t>> values = context.accessors.Unsigned(accessor);
    if (!values.ok()) return At(where, values.status());
    if (decl.components != 1) {
      return absl::InvalidArgumentError(
          absl::StrCat("glTF: ", where, ": indices (accessor ", accessor, ") are not SCALAR"));
    }
    indices = *std::move(values);
  }
  bool incomplete = false;
  absl::StatusOr<std::vector<std::array<uint32_t, 3>>> triangles =
      ExpandTriangles(primitive.mode, indices, out.positions.size(), index_name, context.budget, incomplete);
  if (!triangles.ok()) return triangles.status();
  out.triangles = *std::move(triangles);
  if (incomplete) {
    context.warnings.Add(WarningCode::kIndicesLeftOver, where,
                         "indices left over that complete no triangle are dropped");
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::optional<std::span<const uint8_t>>> DracoStream(const tinygltf::Primitive& primitive,
                                                                    const std::string& where,
                                                                    PrimitiveContext& context) {
  const auto extension = primitive.extensions.find(kDracoExtension);
  if (primitive.mode < kTriangles || extension == primitive.extensions.end()) return std::nullopt;
  const int view = extension->second.Get("bufferView").GetNumberAsInt();
  if (view < 0 || static_cast<size_t>(view) >= context.document.views.size()) {
    return absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ", KHR_draco_mesh_compression: bufferView ", view,
                                                   " is out of range: there are ", context.document.views.size()));
  }
  absl::StatusOr<std::span<const uint8_t>> bytes = context.buffers.View(static_cast<uint32_t>(view), context.budget);
  if (!bytes.ok()) return At(where, bytes.status());
  return std::optional(*bytes);
}

absl::StatusOr<std::optional<Primitive>> ReadPrimitive(const tinygltf::Primitive& primitive,
                                                       const std::vector<double>& weights, const std::string& where,
                                                       PrimitiveContext& context) {
  if (primitive.mode < kTriangles) {
    Primitive empty;
    empty.points_or_lines = true;
    return std::optional<Primitive>(std::move(empty));
  }
  const uint64_t before = context.budget.bytes();
  absl::StatusOr<DracoPart> draco = ReadDraco(primitive, where, context);
  if (!draco.ok()) return draco.status();
  AttributeSource source(primitive.attributes, std::move(draco->ids), std::move(draco->mesh), context);

  Primitive out;
  out.material = primitive.material;
  absl::StatusOr<std::optional<AttributeVectors<Vec3f>>> positions = source.FindVectors<Vec3f>("POSITION");
  if (!positions.ok()) return At(where, positions.status());
  if (!*positions) {
    context.warnings.Add(WarningCode::kNoTriangles, where, "no POSITION, nothing to draw");
    return std::nullopt;
  }
  if ((*positions)->components != 3) {
    return absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ": POSITION (", (*positions)->origin, ") has ",
                                                   (*positions)->components, " components, not 3"));
  }
  out.positions = std::move((*positions)->values);
  if (out.positions.size() > context.budget.limits().max_vertices) {
    return absl::ResourceExhaustedError(absl::StrCat("glTF: ", where, ": ", out.positions.size(),
                                                     " vertices; the limit max_vertices is ",
                                                     context.budget.limits().max_vertices));
  }
  const std::string origin = (*positions)->origin;
  const JobContext& job = context.budget.job();
  if (absl::Status bad = CheckFinite(job, out, origin, where); !bad.ok()) return bad;

  if (source.draco()) {
    CompareCounts(primitive, *source.draco(), where, context);
    if (absl::Status full = context.budget.Take(source.draco()->triangles.size(), sizeof(out.triangles[0]), where);
        !full.ok()) {
      return full;
    }
    out.triangles = source.draco()->triangles;
    // The positions may be those of an accessor, which has another number of vertices than the stream.
    if (out.positions.size() < source.draco()->points) {
      const std::string stream = absl::StrCat(where, ", the Draco stream");
      absl::Status bad = CheckTriangles(out.triangles, out.positions.size(), stream, context.budget);
      if (!bad.ok()) return bad;
    }
  } else if (absl::Status bad = ReadTriangles(primitive, where, out, context); !bad.ok()) {
    return bad;
  }
  if (absl::Status bad = Filler(source, out, where, context).Fill(); !bad.ok()) return bad;
  if (primitive.targets.empty() && out.joints[0].empty()) {
    absl::StatusOr<std::vector<Vec3d>> doubles = source.DoublePositions();
    if (!doubles.ok()) return At(where, doubles.status());
    out.double_positions = *std::move(doubles);
  }
  WarnOfJointSets(primitive, where, context);
  if (absl::Status bad = Morph(primitive, weights, where, out, context); !bad.ok()) return bad;
  if (out.morph) {
    if (absl::Status bad = CheckFinite(job, out, origin + ", morphed", where); !bad.ok()) return bad;
  }
  context.budget.ShrinkTo(before + PrimitiveBytes(out));  // its input is freed
  return std::optional<Primitive>(std::move(out));
}

}  // namespace voxelpipe::gltf

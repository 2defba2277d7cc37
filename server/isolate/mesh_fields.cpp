#include "isolate/mesh_fields.h"

#include <cstdint>
#include <map>
#include <utility>

#include "absl/strings/cord.h"
#include "isolate/rig_fields.h"

namespace voxelpipe {
namespace {

// MeshPart without padding.
struct PackedPart {
  uint64_t first_triangle, triangle_count, first_vertex, vertex_count;
  int32_t material;
  uint32_t mesh, node, primitive;
  uint32_t flags;
  uint32_t unused;
};

PackedPart Pack(const MeshPart& part) {
  uint32_t flags = 0;
  for (const bool flag : {part.has_normals, part.has_tangents, part.has_colors, part.has_uv[0], part.has_uv[1]}) {
    flags = flags << 1 | (flag ? 1 : 0);
  }
  return {part.first_triangle,
          part.triangle_count,
          part.first_vertex,
          part.vertex_count,
          part.material,
          part.mesh,
          part.node,
          part.primitive,
          flags,
          0};
}

MeshPart Unpack(const PackedPart& packed) {
  MeshPart part;
  part.first_triangle = packed.first_triangle;
  part.triangle_count = packed.triangle_count;
  part.first_vertex = packed.first_vertex;
  part.vertex_count = packed.vertex_count;
  part.material = packed.material;
  part.mesh = packed.mesh;
  part.node = packed.node;
  part.primitive = packed.primitive;
  part.has_normals = (packed.flags & 16) != 0;
  part.has_tangents = (packed.flags & 8) != 0;
  part.has_colors = (packed.flags & 4) != 0;
  part.has_uv[0] = (packed.flags & 2) != 0;
  part.has_uv[1] = (packed.flags & 1) != 0;
  return part;
}

template <typename A, typename V>
void OwnAttribute(A& archive, V& attribute) {
  archive.Text(attribute.name);
  archive.Value(attribute.components);
  archive.Array(attribute.values);
  archive.Array(attribute.runs);
}

template <typename A, typename R>
void ReferenceFields(A& archive, R& ref) {
  archive.Value(ref.texture);
  archive.Value(ref.uv_set);
  archive.Value(ref.offset);
  archive.Value(ref.scale);
  archive.Value(ref.rotation);
  archive.Text(ref.fault);
}

template <typename A, typename M>
void MaterialFields(A& archive, M& material) {
  archive.Text(material.name);
  archive.Value(material.base_color_factor);
  ReferenceFields(archive, material.base_color);
  archive.Value(material.emissive_factor);
  archive.Value(material.emissive_strength);
  ReferenceFields(archive, material.emissive);
  archive.Value(material.metallic_factor);
  archive.Value(material.roughness_factor);
  ReferenceFields(archive, material.metallic_roughness);
  archive.Enum(material.alpha_mode, AlphaMode::kBlend);
  archive.Value(material.alpha_cutoff);
  archive.Flag(material.double_sided);
}

template <typename A, typename T>
void TextureField(A& archive, T& texture) {
  archive.Value(texture.image);
  archive.Enum(texture.wrap_s, WrapMode::kClampToEdge);
  archive.Enum(texture.wrap_t, WrapMode::kClampToEdge);
  archive.Flag(texture.nearest);
  archive.Flag(texture.min_nearest);
  archive.Enum(texture.mip_filter, MipFilter::kLinear);
}

template <typename A, typename W>
void WarningFields(A& archive, W& warning) {
  archive.Enum(warning.code, WarningCode::kNotKept);
  archive.Text(warning.place);
  archive.Text(warning.text);
}

void OptionalWarning(ArchiveWriter& archive, const std::optional<Warning>& warning) {
  archive.Flag(warning.has_value());
  if (warning) WarningFields(archive, *warning);
}
void OptionalWarning(ArchiveReader& archive, std::optional<Warning>& warning) {
  bool there = false;
  archive.Flag(there);
  if (there) WarningFields(archive, warning.emplace());
}

void Warnings(ArchiveWriter& archive, const WarningList& list) {
  archive.Each(list.kept(), 17, [](ArchiveWriter& a, const Warning& warning) { WarningFields(a, warning); });
  archive.Value(list.left_out());
}
// At most as many and as long ones as a list accepts.
void Warnings(ArchiveReader& archive, WarningList& list) {
  std::vector<Warning> warnings;
  archive.Each(warnings, 17, [](ArchiveReader& a, Warning& warning) { WarningFields(a, warning); });
  for (const Warning& warning : warnings) list.Add(warning.code, warning.place, warning.text);
  uint64_t left_out = 0;
  archive.Value(left_out);
  list.set_left_out(left_out);
}

template <typename A, typename I>
void ImageFields(A& archive, I& image) {
  archive.Text(image.name);
  archive.Text(image.mime_type);
  archive.Array(image.encoded);
  archive.Value(image.width);
  archive.Value(image.height);
  archive.Array(image.rgba);
  archive.Array(image.linear_mips);
  archive.Array(image.srgb_mips);
  OptionalWarning(archive, image.fault);
}

constexpr uint32_t kNoImage = UINT32_MAX;

// Images may be shared and are sent once: each entry has the index of its image, and the first one its contents.
void Images(ArchiveWriter& archive, const std::vector<std::shared_ptr<Image>>& images) {
  std::map<const Image*, uint32_t> first;
  uint32_t next = 0;
  archive.Each(images, sizeof next, [&](ArchiveWriter& a, const std::shared_ptr<Image>& image) {
    const uint32_t own = next++;
    if (image == nullptr) return a.Value(kNoImage);
    const uint32_t number = first.try_emplace(image.get(), own).first->second;
    a.Value(number);
    if (number == own) ImageFields(a, std::as_const(*image));
  });
}
void Images(ArchiveReader& archive, std::vector<std::shared_ptr<Image>>& images) {
  uint32_t next = 0;
  archive.Each(images, sizeof next, [&](ArchiveReader& a, std::shared_ptr<Image>& image) {
    const uint32_t own = next++;
    uint32_t number = kNoImage;
    a.Value(number);
    if (number == kNoImage || !a.ok()) return;
    if (number > own) return a.Refuse("an image that is not there yet");
    if (number < own) {
      image = images[number];
      return;
    }
    image = std::make_shared<Image>();
    ImageFields(a, *image);
  });
}

void Parts(ArchiveWriter& archive, const std::vector<MeshPart>& parts) {
  archive.Each(parts, sizeof(PackedPart), [](ArchiveWriter& a, const MeshPart& part) { a.Value(Pack(part)); });
}
void Parts(ArchiveReader& archive, std::vector<MeshPart>& parts) {
  archive.Each(parts, sizeof(PackedPart), [](ArchiveReader& a, MeshPart& part) {
    PackedPart packed{};
    a.Value(packed);
    part = Unpack(packed);
  });
}

template <typename A, typename M>
void TexturesOf(A& archive, M& mesh) {
  Parts(archive, mesh.parts);
  archive.Value(mesh.mesh_count);
  archive.Value(mesh.node_count);
  archive.Each(mesh.materials, 100, [](A& a, auto& material) { MaterialFields(a, material); });
  archive.Each(mesh.textures, 9, [](A& a, auto& texture) { TextureField(a, texture); });
  Images(archive, mesh.images);
}

template <typename A, typename M>
void ArraysOf(A& archive, M& mesh) {
  archive.Array(mesh.positions);
  archive.Array(mesh.normals);
  archive.Array(mesh.tangents);
  for (auto& uv : mesh.uv) archive.Array(uv);
  archive.Array(mesh.colors);
  archive.Array(mesh.triangles);
  archive.Each(mesh.attributes, 28, [](A& a, auto& attribute) { OwnAttribute(a, attribute); });
}

template <typename A, typename C>
void ContentsFields(A& archive, C& contents) {
  archive.Text(contents.format);
  archive.Text(contents.unit);
  for (auto* number : {&contents.file_bytes, &contents.nodes, &contents.meshes, &contents.parts, &contents.materials,
                       &contents.textures, &contents.images}) {
    archive.Value(*number);
  }
  archive.Each(contents.attributes, 12, [](A& a, auto& attribute) {
    a.Text(attribute.name);
    a.Value(attribute.components);
  });
}

template <typename A, typename L>
void LoadedFields(A& archive, L& loaded) {
  Fields(archive, loaded.mesh);
  ContentsFields(archive, loaded.contents);
  archive.Value(loaded.load_ms);
  archive.Value(loaded.flatten_ms);
  archive.Value(loaded.peak_bytes);
}

}  // namespace

void Fields(ArchiveWriter& archive, const absl::Status& status) {
  archive.Value(int32_t(status.code()));
  if (status.ok()) return;
  archive.Text(std::string(status.message()));
  std::vector<std::pair<std::string, std::string>> payloads;
  status.ForEachPayload([&](absl::string_view type, const absl::Cord& payload) {
    payloads.emplace_back(std::string(type), std::string(payload));
  });
  archive.Each(payloads, 16, [](ArchiveWriter& a, const auto& payload) {
    a.Text(payload.first);
    a.Text(payload.second);
  });
}

void Fields(ArchiveReader& archive, absl::Status& status) {
  int32_t code = 0;
  archive.Value(code);
  if (code < 0 || code > int32_t(absl::StatusCode::kUnauthenticated)) archive.Refuse("a status code");
  if (code == 0 || !archive.ok()) return;
  std::string message;
  archive.Text(message);
  std::vector<std::pair<std::string, std::string>> payloads;
  archive.Each(payloads, 16, [](ArchiveReader& a, auto& payload) {
    a.Text(payload.first);
    a.Text(payload.second);
  });
  if (!archive.ok()) return;
  status = absl::Status(absl::StatusCode(code), message);
  for (const auto& [type, payload] : payloads) status.SetPayload(type, absl::Cord(payload));
}

void Names(ArchiveWriter& archive, const std::shared_ptr<const SceneNames>& names) {
  const SceneNames none;
  const SceneNames& all = names == nullptr ? none : *names;
  const auto text = [](ArchiveWriter& a, const std::string& name) { a.Text(name); };
  archive.Each(all.nodes, 8, text);
  archive.Array(all.named_by);
  archive.Each(all.meshes, 8, text);
}
void Names(ArchiveReader& archive, std::shared_ptr<const SceneNames>& names) {
  auto read = std::make_shared<SceneNames>();
  const auto text = [](ArchiveReader& a, std::string& name) { a.Text(name); };
  archive.Each(read->nodes, 8, text);
  archive.Array(read->named_by);
  archive.Each(read->meshes, 8, text);
  for (const uint32_t node : read->named_by) {
    if (node >= read->nodes.size()) return archive.Refuse("the name of a node");
  }
  names = std::move(read);
}

void Fields(ArchiveWriter& archive, const TriangleMesh& mesh) {
  ArraysOf(archive, mesh);
  Names(archive, mesh.names);
  archive.Flag(mesh.unused_vertices.has_value());
  if (mesh.unused_vertices) archive.Array(*mesh.unused_vertices);
  TexturesOf(archive, mesh);
  Warnings(archive, mesh.warnings);
  RigFields(archive, mesh.rig);
}

void Fields(ArchiveReader& archive, TriangleMesh& mesh) {
  ArraysOf(archive, mesh);
  Names(archive, mesh.names);
  bool known = false;
  archive.Flag(known);
  if (known) archive.Array(mesh.unused_vertices.emplace());
  TexturesOf(archive, mesh);
  Warnings(archive, mesh.warnings);
  RigFields(archive, mesh.rig);
}

void TextureFields(ArchiveWriter& archive, const TriangleMesh& mesh) {
  TexturesOf(archive, mesh);
}
void TextureFields(ArchiveReader& archive, TriangleMesh& mesh) {
  TexturesOf(archive, mesh);
}

void Fields(ArchiveWriter& archive, const LoadedMesh& loaded) {
  LoadedFields(archive, loaded);
}
void Fields(ArchiveReader& archive, LoadedMesh& loaded) {
  LoadedFields(archive, loaded);
}

}  // namespace voxelpipe

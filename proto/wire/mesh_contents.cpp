#include "wire/mesh_contents.h"

#include <algorithm>

#include "base/text.h"
#include "wire/count.h"
#include "wire/duration.h"
#include "wire/request.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxAttributes = 256, kMaxNameBytes = 256;

}  // namespace

v1::MeshContents ToMessage(const MeshContents& contents, const std::vector<std::pair<std::string, double>>& stages) {
  v1::MeshContents message;
  message.set_format(MeshFormatNamed(contents.format));
  message.set_unit(contents.unit);
  message.set_file_bytes(int64_t(contents.file_bytes));
  message.set_nodes(int64_t(contents.nodes));
  message.set_meshes(int64_t(contents.meshes));
  message.set_parts(int64_t(contents.parts));
  message.set_materials(int64_t(contents.materials));
  message.set_textures(int64_t(contents.textures));
  message.set_images(int64_t(contents.images));
  for (size_t i = 0; i < std::min(kMaxAttributes, contents.attributes.size()); ++i) {
    v1::MeshAttribute* attribute = message.add_attributes();
    attribute->set_name(CleanText(contents.attributes[i].name, kMaxNameBytes));
    attribute->set_components(contents.attributes[i].components);
  }
  for (const auto& [stage, ms] : stages) {
    v1::StageTime* time = message.add_stages();
    time->set_stage(stage);
    WriteMs(ms, *time->mutable_time());
  }
  return message;
}

MeshContents FromMessage(const v1::MeshContents& message) {
  MeshContents contents;
  contents.format = NameOf(message.format());
  contents.unit = message.unit();
  contents.file_bytes = CountOf(message.file_bytes());
  contents.nodes = CountOf(message.nodes());
  contents.meshes = CountOf(message.meshes());
  contents.parts = CountOf(message.parts());
  contents.materials = CountOf(message.materials());
  contents.textures = CountOf(message.textures());
  contents.images = CountOf(message.images());
  for (const v1::MeshAttribute& attribute : message.attributes()) {
    contents.attributes.push_back({attribute.name(), attribute.components()});
  }
  return contents;
}

}  // namespace voxelpipe

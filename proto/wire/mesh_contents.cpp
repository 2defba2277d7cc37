#include "wire/mesh_contents.h"

#include <algorithm>

#include "base/text.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxAttributes = 256, kMaxNameBytes = 256;

}  // namespace

v1::MeshContents ToMessage(const MeshContents& contents, const std::vector<std::pair<std::string, double>>& stages) {
  v1::MeshContents message;
  message.set_format(contents.format);
  message.set_unit(contents.unit);
  message.set_file_bytes(contents.file_bytes);
  message.set_nodes(contents.nodes);
  message.set_meshes(contents.meshes);
  message.set_parts(contents.parts);
  message.set_materials(contents.materials);
  message.set_textures(contents.textures);
  message.set_images(contents.images);
  for (size_t i = 0; i < std::min(kMaxAttributes, contents.attributes.size()); ++i) {
    v1::MeshAttribute* attribute = message.add_attributes();
    attribute->set_name(CleanText(contents.attributes[i].name, kMaxNameBytes));
    attribute->set_components(uint32_t(contents.attributes[i].components));
  }
  for (const auto& [stage, ms] : stages) {
    v1::StageTime* time = message.add_stages();
    time->set_stage(stage);
    time->set_milliseconds(ms);
  }
  return message;
}

MeshContents FromMessage(const v1::MeshContents& message) {
  MeshContents contents;
  contents.format = message.format();
  contents.unit = message.unit();
  contents.file_bytes = message.file_bytes();
  contents.nodes = message.nodes();
  contents.meshes = message.meshes();
  contents.parts = message.parts();
  contents.materials = message.materials();
  contents.textures = message.textures();
  contents.images = message.images();
  for (const v1::MeshAttribute& attribute : message.attributes()) {
    contents.attributes.push_back({attribute.name(), int(attribute.components())});
  }
  return contents;
}

}  // namespace voxelpipe

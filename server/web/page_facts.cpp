#include "web/page_facts.h"

#include <google/protobuf/descriptor.h>
#include <nlohmann/json.hpp>

#include "encode/format_registry.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptor;
using google::protobuf::MethodDescriptor;
using nlohmann::json;

json FieldOf(const FieldDescriptor& field) {
  json facts = {{"number", field.number()}, {"type", field.type_name()}};
  if (field.is_repeated()) facts["repeated"] = true;
  if (field.message_type() != nullptr) facts["of"] = field.message_type()->name();
  if (field.enum_type() != nullptr) facts["of"] = field.enum_type()->name();
  return facts;
}

void AddMethods(const google::protobuf::ServiceDescriptor& service, json& facts) {
  for (int i = 0; i < service.method_count(); ++i) {
    const MethodDescriptor& method = *service.method(i);
    if (method.client_streaming()) continue;
    facts["methods"][method.name()] = {{"request", method.input_type()->name()},
                                       {"response", method.output_type()->name()}};
  }
}

void AddFile(const FileDescriptor& file, json& facts) {
  for (int i = 0; i < file.message_type_count(); ++i) {
    const google::protobuf::Descriptor& message = *file.message_type(i);
    json& fields = facts["messages"][message.name()] = json::object();
    for (int f = 0; f < message.field_count(); ++f) fields[message.field(f)->name()] = FieldOf(*message.field(f));
  }
  for (int i = 0; i < file.enum_type_count(); ++i) {
    const google::protobuf::EnumDescriptor& values = *file.enum_type(i);
    for (int v = 0; v < values.value_count(); ++v) {
      facts["enums"][values.name()][values.value(v)->name()] = values.value(v)->number();
    }
  }
}

}  // namespace

std::string PageFacts() {
  json facts = {{"version", VOXELPIPE_VERSION}};
  const FileDescriptor& file = *v1::VoxelizeUploadRequest::descriptor()->file();
  AddMethods(*file.FindServiceByName("VoxelizationService"), facts);
  AddFile(file, facts);
  for (int i = 0; i < file.dependency_count(); ++i) {
    // google.rpc.Status is only in streams that browsers cannot send.
    if (file.dependency(i)->package() != "google.rpc") AddFile(*file.dependency(i), facts);
  }
  for (const OutputFormat& format : OutputFormats()) {
    facts["formats"].push_back({{"name", format.name},
                                {"title", format.title},
                                {"sparse", format.sparse},
                                {"one_target", format.targets == TargetPlaces::kOne}});
  }
  return facts.dump();
}

}  // namespace voxelpipe

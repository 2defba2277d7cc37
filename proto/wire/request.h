// Requests: core types <-> messages. Used by the server and by the client.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "job/request.h"
#include "load/loader.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "wire/call_settings.h"
#include "wire/placed_stored.h"

namespace voxelpipe {

// A request in the types of the core, without the bytes of its mesh.
struct ParsedConfig {
  MeshFileType mesh_type;   // of the mesh that comes with the request
  VoxelizeRequest request;  // threads stays 0: clients do not choose it
  CallSettings settings;
  bool default_targets = false, default_result = false;  // the message leaves them open
  std::string mesh_name;                                 // of a stored mesh; empty: none
  bool new_positions = false;                            // the mesh bytes are positions for the stored mesh
  // Several stored meshes, with names and labels; null: none. If there is no stored mesh, one comes with the request.
  std::shared_ptr<const std::vector<PlacedStored>> placed;
};

v1::MeshFormat ToMessage(MeshFormat format);
v1::LengthUnit ToMessage(LengthUnit unit);
v1::Backend ToMessage(BackendChoice backend);
v1::Simd ToMessage(SimdChoice simd);
v1::Layout ToMessage(Layout layout);
v1::ResultKind ToMessage(ResultKind kind);
// Names as Name() gives them; of UNSPECIFIED and of values that this program does not know an empty text.
std::string_view NameOf(v1::Backend backend);
std::string_view NameOf(v1::Simd simd);
std::string_view NameOf(v1::MeshFormat format);
// The inverse; UNSPECIFIED for other names.
v1::Backend BackendNamed(std::string_view name);
v1::Simd SimdNamed(std::string_view name);
v1::MeshFormat MeshFormatNamed(std::string_view name);
// INVALID_ARGUMENT naming the field, format or unit behind `prefix`, for a value that this server does not know.
absl::StatusOr<MeshFileType> ParseMeshType(v1::MeshFormat format, v1::LengthUnit unit, const std::string& prefix);

// In: a message from a client; the bytes of its mesh are not read. Out: the request with every default filled in.
// ValidateRequest checks shaders and blends. Errors: INVALID_ARGUMENT "field: why" for enum values that this server
// does not know, a shader parameter given twice, more than kMaxTargets targets, rules of parts that are too many or out
// of range, a negative queue time-out or size of a message, a stored mesh without a name, or what ParsePlaced refuses.
absl::StatusOr<ParsedConfig> ParseRequest(const v1::VoxelizeRequest& request);
// Its two parts: a request without a mesh, and the mesh.
absl::StatusOr<ParsedConfig> ParseRequest(const v1::VoxelizeSpec& spec, const v1::Execution& execution);
absl::Status ParseMesh(const v1::MeshSource& mesh, ParsedConfig& out);

// The inverse. The grid must be in one of its four forms (CheckGridRequest).
void WriteTo(const VoxelizeRequest& request, v1::VoxelizeSpec& spec);
v1::VoxelizeSpec MakeSpec(const VoxelizeRequest& request);
v1::Execution MakeExecution(const VoxelizeRequest& request, const CallSettings& settings = {});
v1::Delivery MakeDelivery(const CallSettings& settings);
// All but the mesh.
v1::VoxelizeRequest MakeRequest(const VoxelizeRequest& request, const CallSettings& settings = {});
// The mesh of a request, without its bytes.
void WriteTo(const MeshFileType& type, v1::MeshBytes& message);

}  // namespace voxelpipe

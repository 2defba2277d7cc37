#include "request_text/grid_like.h"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "encode/read/stored_result.h"
#include "load/local_file.h"

namespace voxelpipe {
namespace {

using nlohmann::json;

constexpr char kWhere[] = "; give an OUT.raw.json, a summary of --json or an .npz";

template <typename... Parts>
absl::Status Wrong(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat(parts...));
}

absl::StatusOr<GridPlace> Checked(const GridPlace& place) {
  for (size_t a = 0; a < 3; ++a) {
    if (place.dims[a] < 1) return Wrong("its dims are no whole numbers of at least 1");
    if (!std::isfinite(place.origin[int(a)])) return Wrong("its origin is not finite");
    const double size = place.voxel_size[int(a)];
    if (!(std::isfinite(size) && size > 0)) return Wrong("its voxel size is not finite and positive");
  }
  return place;
}

absl::StatusOr<GridPlace> PlaceOfNpz(const std::string& path) {
  const absl::StatusOr<StoredResult> stored = OpenResult(path);
  if (!stored.ok()) {  // the caller names the path
    return absl::Status(stored.status().code(), absl::StripPrefix(stored.status().message(), absl::StrCat(path, ": ")));
  }
  if (!stored->place) return Wrong("the archive lacks origin or voxel_size", kWhere);
  return Checked({stored->dims, stored->place->origin, stored->place->voxel_size});
}

absl::StatusOr<GridPlace> PlaceOfJson(const std::string& text) {
  const json object = json::parse(text, nullptr, false);
  if (object.is_discarded()) {
    // Several summaries are JSON lines, which are no JSON together.
    const bool several = json::accept(text.substr(0, text.find('\n')));
    return several ? Wrong("it holds several summaries; keep the line of one in a file of its own")
                   : Wrong("it is neither JSON nor an .npz", kWhere);
  }
  if (!object.is_object()) return Wrong("its JSON is no object", kWhere);
  const auto three = [&](const char* key) {
    const auto found = object.find(key);
    const bool fits = found != object.end() && found->is_array() && found->size() == 3;
    return fits ? *found : json();
  };
  const json dims = three("dims"), origin = three("origin"), voxel_size = three("voxel_size");
  GridPlace place;
  for (size_t a = 0; a < 3; ++a) {
    const bool numbers = dims.is_array() && dims[a].is_number_integer() && origin.is_array() && origin[a].is_number() &&
                         voxel_size.is_array() && voxel_size[a].is_number();
    if (!numbers) return Wrong("it lacks dims, origin or voxel_size, three numbers each", kWhere);
    place.dims[a] = dims[a].get<int64_t>();
    place.origin[int(a)] = origin[a].get<double>();
    place.voxel_size[int(a)] = voxel_size[a].get<double>();
  }
  return Checked(place);
}

}  // namespace

absl::StatusOr<GridPlace> ReadGridPlace(const std::string& path) {
  constexpr uint64_t kMaxJsonBytes = uint64_t{64} << 20;
  std::error_code ignored;
  std::string begin(8, '\0');
  if (std::filesystem::is_regular_file(path, ignored)) {  // to open a FIFO would wait
    std::ifstream(path, std::ios::binary).read(begin.data(), std::streamsize(begin.size()));
  }
  if (begin.starts_with("PK\x03\x04")) return PlaceOfNpz(path);
  if (begin.starts_with("\x93NUMPY")) {
    return Wrong("an .npy does not say where its voxels lie", kWhere);
  }
  const absl::StatusOr<FileBytes> bytes = ReadLocalFile(path, kMaxJsonBytes);
  if (!bytes.ok()) return bytes.status();
  return PlaceOfJson(std::string(bytes->begin(), bytes->end()));
}

}  // namespace voxelpipe

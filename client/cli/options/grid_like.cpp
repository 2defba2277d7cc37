// Sources: PKWARE, "APPNOTE.TXT - .ZIP File Format Specification", version 6.3.10 (local file headers); "NEP 1: A Simple
// File Format for NumPy Arrays", R. Kern, 2007.
#include "options/grid_like.h"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/str_cat.h"
#include "load/local_file.h"

namespace voxelpipe::cli {
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

// Three little-endian numbers of an .npy with this type, or nothing.
template <typename T>
bool ReadThree(const std::string& npy, const char* descr, T (&values)[3]) {
  constexpr size_t kShortHeader = 10;  // magic, version 1.0, length of the dictionary
  if (npy.size() < kShortHeader + sizeof values || npy.compare(0, 8, std::string("\x93NUMPY\x01\0", 8)) != 0)
    return false;
  const size_t length = uint8_t(npy[8]) + (size_t{uint8_t(npy[9])} << 8);
  if (npy.size() != kShortHeader + length + sizeof values) return false;
  const std::string dictionary = npy.substr(kShortHeader, length);
  const bool fits = dictionary.find(absl::StrCat("'descr': '", descr, "'")) != std::string::npos &&
                    dictionary.find("'shape': (3,)") != std::string::npos;
  if (fits) std::memcpy(values, npy.data() + kShortHeader + length, sizeof values);
  return fits;
}

// The small arrays among the entries of a ZIP archive, by name, up to the first entry that does not tell its size.
std::map<std::string, std::string> SmallEntries(std::istream& in) {
  constexpr size_t kHeaderBytes = 30, kMaxKeptBytes = 4096;
  std::map<std::string, std::string> entries;
  std::string header(kHeaderBytes, '\0');
  const auto number = [](const std::string& bytes, size_t at, size_t count) {
    uint64_t value = 0;
    for (size_t i = 0; i < count; ++i) value |= uint64_t{uint8_t(bytes[at + i])} << (8 * i);
    return value;
  };
  while (in.read(header.data(), std::streamsize(kHeaderBytes)) && number(header, 0, 4) == 0x04034b50) {
    std::string name(number(header, 26, 2), '\0'), extra(number(header, 28, 2), '\0');
    in.read(name.data(), std::streamsize(name.size()));
    in.read(extra.data(), std::streamsize(extra.size()));
    uint64_t bytes = number(header, 18, 4);
    const bool zip64 = bytes == 0xffffffff;
    if (zip64) {
      if (extra.size() < 20 || number(extra, 0, 2) != 1) break;
      bytes = number(extra, 12, 8);
    }
    const uint64_t method = number(header, 8, 2), descriptor = (number(header, 6, 2) & 8) != 0 ? (zip64 ? 24 : 16) : 0;
    if (method != 0 || bytes > uint64_t(INT64_MAX) / 2) break;  // compressed: not ours
    if (bytes <= kMaxKeptBytes) {
      std::string data(bytes, '\0');
      if (!in.read(data.data(), std::streamsize(bytes))) break;
      entries[name] = std::move(data);
      in.seekg(std::streamoff(descriptor), std::ios::cur);
    } else {
      in.seekg(std::streamoff(bytes + descriptor), std::ios::cur);
    }
  }
  return entries;
}

absl::StatusOr<GridPlace> PlaceOfNpz(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  const std::map<std::string, std::string> entries = SmallEntries(in);
  const auto entry = [&](const char* name) {
    const auto found = entries.find(name);
    return found == entries.end() ? std::string() : found->second;
  };
  int64_t dims[3];
  double origin[3], voxel_size[3];
  if (!ReadThree(entry("dims.npy"), "<i8", dims) || !ReadThree(entry("origin.npy"), "<f8", origin) ||
      !ReadThree(entry("voxel_size.npy"), "<f8", voxel_size)) {
    return Wrong("the archive lacks dims, origin or voxel_size as voxelpipe writes them", kWhere);
  }
  return Checked(
      {{dims[0], dims[1], dims[2]}, {origin[0], origin[1], origin[2]}, {voxel_size[0], voxel_size[1], voxel_size[2]}});
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

}  // namespace voxelpipe::cli

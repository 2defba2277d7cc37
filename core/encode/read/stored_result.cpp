#include "encode/read/stored_result.h"

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "base/text.h"
#include "encode/encode.h"
#include "encode/raw_description.h"
#include "encode/read/npy_reader.h"
#include "encode/read/zip_reader.h"
#include "grid/grid_spec.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kMaxComponents = 4;
constexpr uint64_t kMaxTargets = 8;

absl::Status Bad(const std::string& where, std::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(where, ": ", std::string(what)));
}

std::string Text(const std::vector<uint64_t>& shape) {
  std::string text = "(";
  for (size_t i = 0; i < shape.size(); ++i) absl::StrAppend(&text, i > 0 ? ", " : "", shape[i]);
  return text + ")";
}

absl::Status CheckDims(const std::string& where, const std::array<int64_t, 3>& dims) {
  for (const int64_t n : dims) {
    if (n < 1 || n > kMaxGridDim) return Bad(where, absl::StrCat("dims of 1 to ", kMaxGridDim, " an axis, not ", n));
  }
  constexpr double kMaxVoxels = 0x1p53;
  if (double(dims[0]) * double(dims[1]) * double(dims[2]) > kMaxVoxels) return Bad(where, "more than 2^53 voxels");
  return absl::OkStatus();
}

// In: the shape of one component. Out: the target, if the array has that shape with an axis of components or without.
absl::StatusOr<StoredTarget> TargetOf(StoredArray array, const std::vector<uint64_t>& shape,
                                      std::optional<bool> planar = std::nullopt) {
  const std::vector<uint64_t>& own = array.shape;
  StoredTarget target;
  if (own == shape) {
    target.array = std::move(array);
    return target;
  }
  if (own.size() == shape.size() + 1) {
    const bool last = std::equal(shape.begin(), shape.end(), own.begin()) && own.back() - 1 < kMaxComponents;
    const bool first = std::equal(shape.begin(), shape.end(), own.begin() + 1) && own.front() - 1 < kMaxComponents;
    target.planar = planar.value_or(!last);
    if (target.planar ? first : last) {
      target.components = int(target.planar ? own.front() : own.back());
      target.array = std::move(array);
      return target;
    }
  }
  return Bad(array.where, absl::StrCat("shape ", Text(own), " does not fit ", Text(shape), " with 1 to ",
                                       kMaxComponents, " components"));
}

std::vector<uint64_t> DenseShape(const StoredResult& result) {
  return {uint64_t(result.dims[2]), uint64_t(result.dims[1]), uint64_t(result.dims[0])};
}

absl::StatusOr<StoredResult> OpenNpy(const std::string& path) {
  absl::StatusOr<std::shared_ptr<const InputFile>> file = InputFile::Open(path);
  if (!file.ok()) return file.status();
  absl::StatusOr<StoredArray> array = ReadNpyHeader(*file, 0, (*file)->bytes(), path);
  if (!array.ok()) return array.status();
  std::vector<uint64_t> shape = array->shape;
  if (shape.size() == 4) {
    const bool last = shape.back() - 1 < kMaxComponents;
    shape.erase(last ? shape.end() - 1 : shape.begin());
  }
  if (shape.size() != 3) {
    return Bad(path, absl::StrCat("shape ", Text(array->shape), ", not (nz, ny, nx) with or without components"));
  }
  StoredResult result;
  result.path = path;
  for (size_t a = 0; a < 3; ++a) {
    if (shape[2 - a] > uint64_t(kMaxGridDim)) return Bad(path, absl::StrCat("shape ", Text(shape), " is too large"));
    result.dims[a] = int64_t(shape[2 - a]);
  }
  if (absl::Status bad = CheckDims(path, result.dims); !bad.ok()) return bad;
  absl::StatusOr<StoredTarget> target = TargetOf(*std::move(array), shape);
  if (!target.ok()) return target.status();
  result.targets.push_back(*std::move(target));
  return result;
}

// The arrays of an .npz by name.
class Archive {
 public:
  static absl::StatusOr<Archive> Open(const std::string& path) {
    Archive archive;
    archive.path_ = path;
    absl::StatusOr<std::shared_ptr<const InputFile>> file = InputFile::Open(path);
    if (!file.ok()) return file.status();
    const absl::StatusOr<std::vector<ZipEntry>> entries = ReadZipDirectory(**file);
    if (!entries.ok()) return entries.status();
    for (const ZipEntry& entry : *entries) {
      constexpr std::string_view kSuffix = ".npy";
      if (!entry.name.ends_with(kSuffix)) continue;
      absl::StatusOr<StoredArray> array =
          ReadNpyHeader(*file, entry.begin, entry.end, absl::StrCat(path, ": ", CleanText(entry.name, 60)));
      if (!array.ok()) return array.status();
      archive.arrays_.emplace(entry.name.substr(0, entry.name.size() - kSuffix.size()), *std::move(array));
    }
    return archive;
  }

  bool Has(const std::string& name) const { return arrays_.contains(name); }
  // The array of that name, type and shape.
  absl::StatusOr<StoredArray> Get(const std::string& name, StoredType type, const std::vector<uint64_t>& shape) const {
    absl::StatusOr<StoredArray> array = Get(name);
    if (!array.ok()) return array;
    if (array->type == type && array->shape == shape) return array;
    return Bad(array->where, absl::StrCat("'", std::string(Name(array->type)), "' of shape ", Text(array->shape),
                                          ", not '", std::string(Name(type)), "' of ", Text(shape)));
  }
  absl::StatusOr<StoredArray> Get(const std::string& name) const {
    const auto found = arrays_.find(name);
    if (found == arrays_.end()) return Bad(path_, absl::StrCat("no array '", name, "', which every result has"));
    return found->second;
  }

 private:
  std::string path_;
  std::map<std::string, StoredArray> arrays_;
};

absl::Status ReadPlace(const Archive& archive, StoredResult& result) {
  const absl::StatusOr<StoredArray> dims = archive.Get("dims", StoredType::kI64, {3});
  if (!dims.ok()) return dims.status();
  const absl::StatusOr<StoredArray> origin = archive.Get("origin", StoredType::kF64, {3});
  if (!origin.ok()) return origin.status();
  const absl::StatusOr<StoredArray> voxel_size = archive.Get("voxel_size", StoredType::kF64, {3});
  if (!voxel_size.ok()) return voxel_size.status();
  ArrayReader n(*dims), o(*origin), h(*voxel_size);
  result.place.emplace();
  for (int a = 0; a < 3; ++a) {
    absl::Status bad = n.NextInteger(result.dims[size_t(a)]);
    if (bad.ok()) bad = o.Next(result.place->origin[a]);
    if (bad.ok()) bad = h.Next(result.place->voxel_size[a]);
    if (!bad.ok()) return bad;
  }
  return CheckDims(dims->where, result.dims);
}

// Sets kind and lists; `shape` is that of a target's component.
absl::Status ReadLists(const Archive& archive, StoredResult& result, std::vector<uint64_t>& shape) {
  shape = DenseShape(result);
  if (!archive.Has("ijk")) return absl::OkStatus();
  absl::StatusOr<StoredArray> ijk = archive.Get("ijk");
  if (!ijk.ok()) return ijk.status();
  const uint64_t listed = ijk->shape.empty() ? 0 : ijk->shape[0];
  if (ijk = archive.Get("ijk", StoredType::kI32, {listed, 3}); !ijk.ok()) return ijk.status();
  if (listed > result.voxels()) return Bad(ijk->where, "more voxels than the grid has");
  result.kind = archive.Has("offsets") ? ResultKind::kBuckets : ResultKind::kSparse;
  result.ijk = *std::move(ijk);
  shape = {listed};
  if (result.kind == ResultKind::kSparse) return absl::OkStatus();
  absl::StatusOr<StoredArray> offsets = archive.Get("offsets", StoredType::kI64, {listed + 1});
  if (!offsets.ok()) return offsets.status();
  absl::StatusOr<StoredArray> triangle = archive.Get("triangle");
  if (!triangle.ok()) return triangle.status();
  shape = {triangle->shape.empty() ? 0 : triangle->shape[0]};
  if (triangle = archive.Get("triangle", StoredType::kU32, shape); !triangle.ok()) return triangle.status();
  result.offsets = *std::move(offsets);
  result.triangle = *std::move(triangle);
  return absl::OkStatus();
}

absl::StatusOr<StoredResult> OpenNpz(const std::string& path) {
  const absl::StatusOr<Archive> archive = Archive::Open(path);
  if (!archive.ok()) return archive.status();
  StoredResult result;
  result.path = path;
  std::vector<uint64_t> shape;
  if (absl::Status bad = ReadPlace(*archive, result); !bad.ok()) return bad;
  if (absl::Status bad = ReadLists(*archive, result, shape); !bad.ok()) return bad;
  for (uint64_t i = 0; i < kMaxTargets; ++i) {
    const std::string name = absl::StrCat("target", i);
    if (i > 0 && !archive->Has(name)) break;
    absl::StatusOr<StoredArray> array = archive->Get(name);
    if (!array.ok()) return array.status();
    absl::StatusOr<StoredTarget> target = TargetOf(*std::move(array), shape);
    if (!target.ok()) return target.status();
    result.targets.push_back(*std::move(target));
  }
  return result;
}

// Throws nlohmann's exceptions where the description has another form.
absl::Status ReadDescription(const nlohmann::json& about, const std::string& path, const std::string& where,
                             StoredResult& result) {
  result.dims = about.at("dims").get<std::array<int64_t, 3>>();
  if (absl::Status bad = CheckDims(where, result.dims); !bad.ok()) return bad;
  const auto origin = about.at("origin").get<std::array<double, 3>>();
  const auto voxel_size = about.at("voxel_size").get<std::array<double, 3>>();
  result.place = {{origin[0], origin[1], origin[2]}, {voxel_size[0], voxel_size[1], voxel_size[2]}};
  const bool planar = about.at("layout").get<std::string>() == "planar";
  const nlohmann::json& targets = about.at("targets");
  if (!targets.is_array() || targets.empty() || targets.size() > kMaxTargets) {
    return Bad(where, absl::StrCat("1 to ", kMaxTargets, " targets"));
  }
  for (const nlohmann::json& target : targets) {
    const auto name = target.at("file").get<std::string>();
    if (std::filesystem::path(name).filename().string() != name || name == "." || name == "..") {
      return Bad(where, absl::StrCat("'", CleanText(name, 60), "' is not the name of a file beside it"));
    }
    const std::string sibling = (std::filesystem::path(path).parent_path() / name).string();
    absl::StatusOr<std::shared_ptr<const InputFile>> file = InputFile::Open(sibling);
    if (!file.ok()) return file.status();
    const std::optional<StoredType> type = ParseStoredType(target.at("dtype").get<std::string>());
    if (!type) return Bad(where, "a dtype that no result has");
    StoredArray array{sibling, *file, 0, *type, {}};
    const nlohmann::json& shape = target.at("shape");
    if (!shape.is_array() || shape.size() > 4) return Bad(where, "a shape that no result has");
    for (const nlohmann::json& n : shape) array.shape.push_back(n.get<uint64_t>());
    const std::optional<uint64_t> count = ElementsOf(array.shape);
    const std::optional<uint64_t> bytes = count ? StoredBytes(*type, *count) : std::nullopt;
    if (bytes != (*file)->bytes()) {
      return Bad(sibling, absl::StrCat((*file)->bytes(), " bytes, its description needs ", bytes.value_or(0)));
    }
    absl::StatusOr<StoredTarget> read = TargetOf(std::move(array), DenseShape(result), planar);
    if (!read.ok()) return read.status();
    result.targets.push_back(*std::move(read));
  }
  return absl::OkStatus();
}

absl::StatusOr<StoredResult> OpenRaw(const std::string& path, const std::string& description) {
  constexpr uint64_t kMaxDescriptionBytes = uint64_t{64} << 20;  // of the most parts, some megabytes
  absl::StatusOr<std::shared_ptr<const InputFile>> file = InputFile::Open(description);
  if (absl::IsNotFound(file.status())) {
    return absl::NotFoundError(absl::StrCat(
        description, ": no such file; it describes the result (of several targets give OUT.raw, not OUT.0.raw)"));
  }
  if (!file.ok()) return file.status();
  if ((*file)->bytes() > kMaxDescriptionBytes) return Bad(description, "too large for a description");
  std::string text((*file)->bytes(), '\0');
  if (absl::Status s = (*file)->ReadAt(0, {reinterpret_cast<uint8_t*>(text.data()), text.size()}); !s.ok()) return s;
  StoredResult result;
  result.path = path;
  try {
    if (absl::Status s = ReadDescription(nlohmann::json::parse(text), path, description, result); !s.ok()) return s;
  } catch (const nlohmann::json::exception& error) {
    return Bad(description, absl::StrCat("not the description of a .raw: ", CleanText(error.what(), 200)));
  }
  return result;
}

}  // namespace

absl::StatusOr<StoredResult> OpenResult(const std::string& path) {
  const std::string extension = FileExtension(path);
  if (extension == ".npy") return OpenNpy(path);
  if (extension == ".npz") return OpenNpz(path);
  if (extension == ".raw") return OpenRaw(path, RawDescriptionPath(path));
  if (extension == ".json") return OpenRaw(path, path);
  return Bad(path, "not a result: .npy, .npz, .raw or .raw.json");
}

}  // namespace voxelpipe

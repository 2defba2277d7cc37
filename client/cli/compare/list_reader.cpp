#include "compare/list_reader.h"

#include "absl/strings/str_cat.h"

namespace voxelpipe::cli {
namespace {

absl::Status Bad(const StoredArray& array, uint64_t element, std::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(array.where, ": element ", element, " ", std::string(what)));
}

}  // namespace

ListReader::ListReader(const StoredResult& result)
    : result_(result), ijk_reader_(result.ijk), offsets_(result.offsets), triangles_(result.triangle) {}

uint64_t ListReader::KeyOf(const std::array<int64_t, 3>& ijk) const {
  const auto x = uint64_t(ijk[0]), y = uint64_t(ijk[1]), z = uint64_t(ijk[2]);
  const auto nx = uint64_t(result_.dims[0]), ny = uint64_t(result_.dims[1]);
  if (result_.kind == ResultKind::kBuckets) return x + nx * (y + ny * z);
  const uint64_t brick = x / 8 + (nx + 7) / 8 * (y / 8 + (ny + 7) / 8 * (z / 8));
  return brick * 512 + x % 8 + 8 * (y % 8 + 8 * (z % 8));
}

absl::Status ListReader::Next() {
  const bool buckets = result_.kind == ResultKind::kBuckets;
  if (buckets && next_ == 0) {
    if (absl::Status bad = offsets_.NextInteger(end_); !bad.ok()) return bad;
    if (end_ != 0) return Bad(result_.offsets, 0, "is not 0");
  }
  triangles_.Skip(fragments_ - triangles_read_);
  triangles_read_ = 0;
  const auto all = int64_t(result_.triangle.shape.empty() ? 0 : result_.triangle.shape[0]);
  if (next_ == result_.listed()) {
    if (buckets && end_ != all) return Bad(result_.offsets, next_, "is not the number of fragments");
    key_ = kEnd;
    fragments_ = 0;
    return absl::OkStatus();
  }
  for (size_t a = 0; a < 3; ++a) {
    if (absl::Status bad = ijk_reader_.NextInteger(ijk_[a]); !bad.ok()) return bad;
    if (ijk_[a] < 0 || ijk_[a] >= result_.dims[a]) return Bad(result_.ijk, next_, "lies outside the grid");
  }
  const uint64_t key = KeyOf(ijk_);
  if (next_ > 0 && key <= key_) return Bad(result_.ijk, next_, "is not in the order of a result");
  key_ = key;
  ++next_;
  fragments_ = buckets ? 0 : 1;
  if (!buckets) return absl::OkStatus();
  const int64_t begin = end_;
  if (absl::Status bad = offsets_.NextInteger(end_); !bad.ok()) return bad;
  if (end_ <= begin || end_ > all) return Bad(result_.offsets, next_, "does not ascend within the fragments");
  fragments_ = uint64_t(end_ - begin);
  return absl::OkStatus();
}

absl::Status ListReader::NextTriangle(int64_t& triangle) {
  triangle = 0;
  if (result_.kind != ResultKind::kBuckets) return absl::OkStatus();
  ++triangles_read_;
  return triangles_.NextInteger(triangle);
}

}  // namespace voxelpipe::cli

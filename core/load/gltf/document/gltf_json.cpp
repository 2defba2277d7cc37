#include "load/gltf/document/gltf_json.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

namespace voxelpipe::gltf {
namespace {

using Json = nlohmann::json;

// Members of the document that the loader reads.
constexpr std::array<std::string_view, 16> kRead = {
    "accessors", "animations", "asset",  "bufferViews", "buffers",  "extensions", "extensionsRequired",
    "images",    "materials",  "meshes", "nodes",       "samplers", "scene",      "scenes",
    "skins",     "textures"};

// Bytes of the tree, including the overhead of the allocator. Arrays are charged as they grow.
constexpr uint64_t kValueBytes = 24, kMemberBytes = 112, kContainerBytes = 72, kStringBytes = 40;
constexpr uint64_t kChargeStep = 1 << 16;
constexpr std::ptrdiff_t kPollStep = 1 << 16;  // characters

// The characters of the text, which ends early if the job ends.
class Reader {
 public:
  using iterator_category = std::forward_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;

  Reader() = default;
  Reader(const JobContext& job, const char* at, const char* end) : job_(&job), at_(at), end_(end), look_(at + Step()) {}

  reference operator*() const { return *at_; }
  Reader& operator++() {
    if (++at_ == look_) Look();
    return *this;
  }
  Reader operator++(int) {
    const Reader old = *this;
    ++*this;
    return old;
  }
  friend bool operator==(const Reader& a, const Reader& b) { return a.at_ == b.at_; }

 private:
  std::ptrdiff_t Step() const { return std::min(kPollStep, end_ - at_); }
  void Look() {
    if (!job_->Check().ok()) at_ = end_;
    look_ = at_ + Step();
  }

  const JobContext* job_ = nullptr;
  const char *at_ = nullptr, *end_ = nullptr, *look_ = nullptr;
};

// Builds the tree from the parser's events; their names are nlohmann's.
class TreeBuilder : public nlohmann::json_sax<Json> {
 public:
  TreeBuilder(const LoadLimits& limits, MemoryCharge& charge) : limits_(limits), charge_(charge) {}

  Json TakeRoot() { return std::move(root_); }
  const absl::Status& status() const { return status_; }

  bool null() override { return Scalar(nullptr, 0); }
  bool boolean(bool value) override { return Scalar(value, 0); }
  bool number_integer(number_integer_t value) override { return Scalar(value, 0); }
  bool number_unsigned(number_unsigned_t value) override { return Scalar(value, 0); }
  bool number_float(number_float_t value, const string_t& /*text*/) override { return Scalar(value, 0); }
  bool string(string_t& value) override {
    // Twice: the loader makes copies.
    const uint64_t bytes = kStringBytes + 2 * value.size();
    return Scalar(std::move(value), bytes);
  }
  bool binary(binary_t& /*value*/) override { return false; }  // no JSON

  bool start_object(std::size_t /*size*/) override { return Begin(Json::value_t::object); }
  bool end_object() override { return End(); }
  bool start_array(std::size_t /*size*/) override { return Begin(Json::value_t::array); }
  bool end_array() override { return End(); }

  bool key(string_t& name) override {
    if (skipped_ > 0) return true;
    const bool of_document = open_.size() == 1;
    if (name == "extras" || (of_document && std::find(kRead.begin(), kRead.end(), name) == kRead.end())) {
      skip_next_ = true;
      return true;
    }
    if (!Charge(kMemberBytes + name.size())) return false;
    member_ = &open_.back()->get_ref<Json::object_t&>()[std::move(name)];
    return true;
  }

  bool parse_error(std::size_t at, const std::string& /*token*/, const nlohmann::detail::exception& /*why*/) override {
    return Fail(absl::InvalidArgumentError(absl::StrCat("glTF: the JSON is broken at its byte ", at)));
  }

 private:
  bool Fail(absl::Status status) {
    if (status_.ok()) status_ = std::move(status);
    return false;
  }

  // Bytes of a value at the current position; those of an array have their place in it.
  uint64_t ValueBytes() const { return !open_.empty() && open_.back()->is_array() ? 0 : kValueBytes; }

  bool Charge(uint64_t bytes) {
    tree_bytes_ += bytes;
    if (tree_bytes_ <= charged_) return true;
    if (tree_bytes_ > limits_.max_json_tree_bytes) {
      return Fail(absl::ResourceExhaustedError(absl::StrCat(
          "glTF: the JSON takes more memory than the limit max_json_tree_bytes, ", limits_.max_json_tree_bytes)));
    }
    const uint64_t more = std::max(kChargeStep, tree_bytes_ - charged_);
    if (absl::Status full = charge_.Grow(more, "glTF: the JSON:"); !full.ok()) return Fail(std::move(full));
    charged_ += more;
    return true;
  }

  // Room for another value in the innermost array. A list that grows does so to twice its size, and is copied then.
  bool MakeRoom() {
    if (open_.empty() || !open_.back()->is_array()) return true;
    auto& array = open_.back()->get_ref<Json::array_t&>();
    if (array.size() < array.capacity()) return true;
    const size_t before = array.capacity(), grown = std::max<size_t>(2, 2 * before);
    if (!Charge(grown * sizeof(Json))) return false;
    array.reserve(grown);
    tree_bytes_ -= before * sizeof(Json);
    return true;
  }

  // Inserts a value at the current position of the tree. Out: its address.
  Json* Add(Json&& value) {
    if (open_.empty()) {
      root_ = std::move(value);
      return &root_;
    }
    if (open_.back()->is_array()) {
      auto& array = open_.back()->get_ref<Json::array_t&>();
      array.push_back(std::move(value));
      return &array.back();
    }
    *member_ = std::move(value);
    return member_;
  }

  template <typename Value>
  bool Scalar(Value&& value, uint64_t bytes) {
    if (skipped_ > 0 || std::exchange(skip_next_, false)) return true;
    if (!Charge(ValueBytes() + bytes) || !MakeRoom()) return false;
    Add(Json(std::forward<Value>(value)));
    return true;
  }

  bool Begin(Json::value_t type) {
    if (skipped_ > 0 || std::exchange(skip_next_, false)) {
      ++skipped_;
      return true;
    }
    if (!Charge(ValueBytes() + kContainerBytes) || !MakeRoom()) return false;
    open_.push_back(Add(Json(type)));
    return true;
  }

  bool End() {
    if (skipped_ > 0) {
      --skipped_;
    } else {
      open_.pop_back();
    }
    return true;
  }

  const LoadLimits& limits_;
  MemoryCharge& charge_;
  uint64_t tree_bytes_ = 0, charged_ = 0;
  absl::Status status_;
  Json root_;
  std::vector<Json*> open_;  // containers around the next value; their addresses are stable while they are open
  Json* member_ = nullptr;   // of the innermost object
  bool skip_next_ = false;
  uint64_t skipped_ = 0;  // containers around the next value, from the first skipped one
};

}  // namespace

absl::StatusOr<Json> ParseJson(const JobContext& job, std::string_view text, const LoadLimits& limits,
                               MemoryCharge& charge) {
  TreeBuilder builder(limits, charge);
  const char* const end = text.data() + text.size();
  Json::sax_parse(Reader(job, text.data(), end), Reader(job, end, end), &builder);
  if (absl::Status over = job.Check(); !over.ok()) return over;
  if (!builder.status().ok()) return builder.status();
  return builder.TakeRoot();
}

}  // namespace voxelpipe::gltf

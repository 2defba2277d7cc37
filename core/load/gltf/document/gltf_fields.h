// Typed reading of an untrusted JSON object: wrong types and dangling indices become one Status that says where it is.
// Include only from files that contain nlohmann's exceptions.
#pragma once

#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "base/job_context.h"
#include "base/warning.h"

namespace voxelpipe::gltf {

using Json = nlohmann::json;

// A non-negative integer; 3.0 counts as one.
inline std::optional<uint64_t> AsUnsigned(const Json& value) {
  if (value.is_number_unsigned()) return value.get<uint64_t>();
  if (value.is_number_float()) {
    const double number = value.get<double>();
    if (number >= 0 && number < 9007199254740992.0 && std::floor(number) == number)
      return static_cast<uint64_t>(number);
  }
  return std::nullopt;
}

// Reads the members of one object. The first error sticks in `status` and later reads give their fallback.
class Fields {
 public:
  // `object` and `status` must outlive this.
  Fields(const Json& object, std::string where, absl::Status& status)
      : object_(object), where_(std::move(where)), status_(status) {
    if (!object_.is_object()) Fail("is not an object");
  }

  const Json* Find(const char* key) const {
    if (!object_.is_object()) return nullptr;
    const auto it = object_.find(key);
    return it == object_.end() ? nullptr : &*it;
  }

  uint64_t Unsigned(const char* key, uint64_t fallback) {
    const Json* value = Find(key);
    if (value == nullptr) return fallback;
    const std::optional<uint64_t> number = AsUnsigned(*value);
    if (!number) Fail(absl::StrCat(key, " is not a non-negative integer"));
    return number.value_or(fallback);
  }

  uint64_t RequiredUnsigned(const char* key) {
    if (Find(key) == nullptr) Fail(absl::StrCat(key, " is missing"));
    return Unsigned(key, 0);
  }

  // An index below `size` into the array called `target`; -1 if the member is absent.
  int64_t Index(const char* key, uint64_t size, const char* target) {
    if (Find(key) == nullptr) return -1;
    const uint64_t number = Unsigned(key, 0);
    if (status_.ok() && number >= size) {
      Fail(absl::StrCat(key, " ", number, " is out of range: there are ", size, " ", target));
    }
    return status_.ok() ? static_cast<int64_t>(number) : -1;
  }

  // Like Index; an absent member is an error. 0 after an error.
  uint32_t RequiredIndex(const char* key, uint64_t size, const char* target) {
    if (Find(key) == nullptr) Fail(absl::StrCat(key, " is missing"));
    const int64_t index = Index(key, size, target);
    return index < 0 ? 0 : static_cast<uint32_t>(index);
  }

  std::string String(const char* key, const std::string& fallback = "") {
    const Json* value = Find(key);
    if (value == nullptr) return fallback;
    if (!value->is_string()) {
      Fail(absl::StrCat(key, " is not a string"));
      return fallback;
    }
    return value->get<std::string>();
  }

  bool Bool(const char* key, bool fallback) {
    const Json* value = Find(key);
    if (value == nullptr) return fallback;
    if (!value->is_boolean()) Fail(absl::StrCat(key, " is not true or false"));
    return value->is_boolean() ? value->get<bool>() : fallback;
  }

  // The array called `key`, or null if absent. Fails on another type or more than `most` elements.
  const Json* Array(const char* key, uint64_t most = UINT64_MAX) {
    const Json* value = Find(key);
    if (value == nullptr) return nullptr;
    if (!value->is_array()) {
      Fail(absl::StrCat(key, " is not an array"));
      return nullptr;
    }
    if (value->size() > most) {
      Fail(absl::StrCat(key, " has ", value->size(), " elements; the most is ", most));
      return nullptr;
    }
    return value;
  }

  void Fail(const std::string& what) {
    if (status_.ok()) status_ = absl::InvalidArgumentError(absl::StrCat("glTF: ", where_, ": ", what));
  }

  const std::string& where() const { return where_; }
  bool ok() const { return status_.ok(); }

 private:
  const Json& object_;
  std::string where_;
  absl::Status& status_;
};

// Adds an ignored error of Fields as a warning; `where` is that of the Fields.
inline void AddIgnored(const absl::Status& ignored, const std::string& where, WarningList& warnings) {
  if (ignored.ok()) return;
  const absl::string_view what = absl::StripPrefix(ignored.message(), absl::StrCat("glTF: ", where, ": "));
  warnings.Add(WarningCode::kNonconformingFile, where, absl::StrCat(what, "; it is ignored"));
}

// True if element `i` of an array is to be read; polls the job now and then. The first error sticks.
inline bool GoOn(const JobContext& job, size_t i, absl::Status& status) {
  constexpr size_t kElementsAStep = 1024;
  if (i % kElementsAStep == 0 && status.ok()) status = job.Check();
  return status.ok();
}

// The elements of root[key], 0 if it is no array.
inline uint64_t ArraySize(const Json& root, const char* key) {
  const auto it = root.find(key);
  return it != root.end() && it->is_array() ? it->size() : 0;
}

}  // namespace voxelpipe::gltf

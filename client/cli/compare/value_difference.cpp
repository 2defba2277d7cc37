#include "compare/value_difference.h"

#include <algorithm>
#include <cmath>

namespace voxelpipe::cli {

TargetReader::TargetReader(const StoredTarget& target) : components_(target.components) {
  const uint64_t plane = target.array.count() / uint64_t(components_);
  for (int c = 0; c < (target.planar ? components_ : 1); ++c) readers_.emplace_back(target.array, uint64_t(c) * plane);
}

absl::Status TargetReader::Next(std::span<double> out) {
  for (size_t c = 0; c < out.size(); ++c) {
    if (absl::Status bad = readers_[readers_.size() == 1 ? 0 : c].Next(out[c]); !bad.ok()) return bad;
  }
  return absl::OkStatus();
}

void TargetReader::Skip(uint64_t elements) {
  for (ArrayReader& reader : readers_) reader.Skip(readers_.size() == 1 ? elements * uint64_t(components_) : elements);
}

ValuePair::ValuePair(const StoredResult& a, const StoredResult& b, double tolerance) : tolerance_(tolerance) {
  for (const auto& [result, readers, numbers] : {std::tuple(&a, &readers_a_, &a_), std::tuple(&b, &readers_b_, &b_)}) {
    for (const StoredTarget& target : result->targets) {
      readers->emplace_back(target);
      numbers->emplace_back(size_t(target.components));
    }
  }
}

absl::Status ValuePair::Next(std::vector<TargetReader>& readers, Numbers& numbers) {
  for (size_t t = 0; t < readers.size(); ++t) {
    if (absl::Status bad = readers[t].Next(numbers[t]); !bad.ok()) return bad;
  }
  return absl::OkStatus();
}

void ValuePair::SkipA(uint64_t elements) {
  for (TargetReader& reader : readers_a_) reader.Skip(elements);
}

void ValuePair::SkipB(uint64_t elements) {
  for (TargetReader& reader : readers_b_) reader.Skip(elements);
}

bool ValuePair::Occupied(const Numbers& numbers) {
  return std::any_of(numbers.begin(), numbers.end(), [](const std::vector<double>& components) {
    return std::any_of(components.begin(), components.end(), [](double value) { return value != 0; });
  });
}

int ValuePair::Difference(ComparedValues& values) const {
  int first = -1;
  for (size_t t = 0; t < a_.size(); ++t) {
    for (size_t c = 0; c < a_[t].size(); ++c) {
      const double x = a_[t][c], y = b_[t][c];
      if (x == y || (std::isnan(x) && std::isnan(y))) continue;
      const double difference = std::abs(x - y);
      if (difference > values.largest) values.largest = difference;
      const bool within = difference <= tolerance_;  // false with a NaN
      if (!within && first < 0) first = int(t);
    }
  }
  return first;
}

}  // namespace voxelpipe::cli

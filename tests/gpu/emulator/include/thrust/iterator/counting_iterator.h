#pragma once

#include <cstdint>

namespace thrust {

template <typename T>
struct counting_iterator {
  T first;
  explicit counting_iterator(T f) : first(f) {}
  T operator[](uint64_t i) const { return T(first + T(i)); }
};

}  // namespace thrust

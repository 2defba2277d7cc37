// Small generated results, for tests of encoders.
#pragma once

#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>
#include <vector>

#include "pipeline/voxelize.h"
#include "support/resources/temporary_directory.h"

namespace voxelpipe::testing {

inline std::vector<uint8_t> ReadFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

using BitFormula = std::function<bool(int64_t i, int64_t j, int64_t k)>;
using ValueFormula = std::function<float(int64_t i, int64_t j, int64_t k, int c)>;

inline VoxelizeResult EmptyResult(std::array<int64_t, 3> dims, Layout layout = Layout::kInterleaved) {
  VoxelizeResult result;
  result.grid.dims = dims;
  result.layout = layout;
  return result;
}

inline void AddBits(VoxelizeResult& result, const BitFormula& formula) {
  const auto& d = result.grid.dims;
  HostBuffer buffer = HostBuffer::Allocate((result.grid.voxels() + 7) / 8).value();
  std::memset(buffer.data(), 0, buffer.size());
  for (int64_t k = 0, n = 0; k < d[2]; ++k) {
    for (int64_t j = 0; j < d[1]; ++j) {
      for (int64_t i = 0; i < d[0]; ++i, ++n) {
        if (formula(i, j, k)) buffer.data()[n / 8] |= uint8_t(1 << (n % 8));
      }
    }
  }
  result.specs.push_back(TargetSpec{});
  result.targets.push_back(std::move(buffer));
}

inline void AddFloats(VoxelizeResult& result, int components, const ValueFormula& formula,
                      const std::string& shader = "constant") {
  const auto& d = result.grid.dims;
  HostBuffer buffer = HostBuffer::Allocate(result.grid.voxels() * uint64_t(components) * 4).value();
  for (int64_t k = 0, n = 0; k < d[2]; ++k) {
    for (int64_t j = 0; j < d[1]; ++j) {
      for (int64_t i = 0; i < d[0]; ++i, ++n) {
        for (int c = 0; c < components; ++c) {
          const uint64_t at = result.layout == Layout::kPlanar ? uint64_t(c) * result.grid.voxels() + uint64_t(n)
                                                               : uint64_t(n) * uint64_t(components) + uint64_t(c);
          const float value = formula(i, j, k, c);
          std::memcpy(buffer.data() + 4 * at, &value, 4);
        }
      }
    }
  }
  TargetSpec spec;
  spec.format = VoxelFormat::kF32;
  spec.components = components;
  spec.blend = Blend::kReplace;
  spec.shader = {shader, {}};
  result.specs.push_back(spec);
  result.targets.push_back(std::move(buffer));
}

using LabelFormula = std::function<uint32_t(int64_t i, int64_t j, int64_t k)>;

// A target of labels of parts.
template <typename T>
void AddLabels(VoxelizeResult& result, const LabelFormula& formula) {
  const auto& d = result.grid.dims;
  HostBuffer buffer = HostBuffer::Allocate(result.grid.voxels() * sizeof(T)).value();
  for (int64_t k = 0, n = 0; k < d[2]; ++k) {
    for (int64_t j = 0; j < d[1]; ++j) {
      for (int64_t i = 0; i < d[0]; ++i, ++n) {
        const T label = T(formula(i, j, k));
        std::memcpy(buffer.data() + uint64_t(n) * sizeof(T), &label, sizeof(T));
      }
    }
  }
  TargetSpec spec;
  spec.format = sizeof(T) == 1 ? VoxelFormat::kU8 : sizeof(T) == 2 ? VoxelFormat::kU16 : VoxelFormat::kU32;
  spec.blend = Blend::kReplace;
  spec.shader = {"label", {}};
  result.specs.push_back(spec);
  result.targets.push_back(std::move(buffer));
}

// A part of a table: label and name. Its other columns follow from its number.
using SamplePart = std::pair<uint32_t, std::string>;

inline void AddParts(VoxelizeResult& result, const std::vector<SamplePart>& parts, bool filled = true) {
  PartTable& table = result.parts;
  table = MakePartTable({parts.size(), filled, 0});
  for (size_t i = 0; i < parts.size(); ++i) {
    table.label[i] = parts[i].first;
    table.priority[i] = int32_t(i) - 1;
    table.triangles[i] = 10 + i;
    if (filled) {
      table.open_edges[i] = i % 3;
      table.odd_columns[i] = i % 5;
      table.voxels[i] = 100 + i;
    }
    table.name.insert(table.name.end(), parts[i].second.begin(), parts[i].second.end());
    table.name_offset[i + 1] = table.name.size();
  }
}

// Hostile names, and as CleanText shows them.
inline const std::vector<std::pair<std::string, std::string>>& HostileNames() {
  static const std::vector<std::pair<std::string, std::string>> names = {
      {"plain", "plain"},
      {"", ""},
      {"a\nb\r\tc:=d", "a?b??c:=d"},
      {"\"quoted\" 'too' \\n", "\"quoted\" 'too' \\n"},
      {"</script><b>&amp;]]>-->", "</script><b>&amp;]]>-->"},
      {std::string("nul\0nul", 7), "nul?nul"},
      {"\xff\xfe no UTF-8 \xc3", "?? no UTF-8 ?"},
      {"Fl\xc3\xbcgel \xe2\x80\xae drawkcab", "Fl\xc3\xbcgel ? drawkcab"},
      {"\x1b[31m\x7f\xc2\x9b", "?[31m??"},
      {std::string(300, 'n'), std::string(300, 'n')}};
  return names;
}

// A part of each hostile name, with labels from 1.
inline void AddHostileParts(VoxelizeResult& result) {
  std::vector<SamplePart> parts;
  for (const auto& [name, clean] : HostileNames()) parts.emplace_back(uint32_t(parts.size() + 1), name);
  AddParts(result, parts);
}

// The formulas, which check_npy.py repeats.
inline bool SampleBit(int64_t i, int64_t j, int64_t k) {
  return (7 * i + 3 * j + 5 * k) % 3 == 0;
}
inline float SampleValue(int64_t i, int64_t j, int64_t k, int c) {
  return float(i + 10 * j + 100 * k + 1000 * c) + 0.5f;
}

}  // namespace voxelpipe::testing

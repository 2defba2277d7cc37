// Parts from their definition: which bodies they have, their names, labels, priorities and ranks.
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "oracle/parts/parts_reference.h"

namespace voxelpipe::testing {
namespace {

// One character, in UTF-8, from the beginning.
size_t CharacterSize(const std::string& text) {
  size_t size = 1;
  while (size < text.size() && (uint8_t(text[size]) & 0xc0) == 0x80) ++size;
  return size;
}

bool Matches(const std::string& pattern, const std::string& name) {
  if (pattern.empty()) return name.empty();
  const std::string rest = pattern.substr(1);
  if (pattern[0] == '*') return Matches(rest, name) || (!name.empty() && Matches(pattern, name.substr(1)));
  if (name.empty()) return false;
  if (pattern[0] == '?') return Matches(rest, name.substr(CharacterSize(name)));
  return pattern[0] == name[0] && Matches(rest, name.substr(1));
}

int64_t LastRule(const std::vector<PartRule>& rules, const std::string& name, int64_t otherwise) {
  for (const PartRule& rule : rules) {
    if (Matches(rule.pattern, name)) otherwise = rule.number;
  }
  return otherwise;
}

// What bodies of one part have in common, and its name.
std::pair<int64_t, std::string> KeyOf(const Assembly& assembly, const TaggedBody& body, PartScope scope) {
  switch (scope) {
    case PartScope::kWhole: return {0, ""};
    case PartScope::kFile: return {int64_t(body.file), assembly.files[body.file].name};
    case PartScope::kNode: return {body.instance, body.node_name};
    case PartScope::kMesh: return {body.mesh, body.mesh_name};
    case PartScope::kMaterial:
      return {body.material, body.material < 0 ? "" : assembly.materials[size_t(body.material)].name};
  }
  return {};
}

}  // namespace

ReferenceParts CutParts(const Assembly& assembly, const PartSelection& selection) {
  ReferenceParts cut;
  std::map<int64_t, size_t> numbers;
  for (size_t b = 0; b < assembly.bodies.size(); ++b) {
    const TaggedBody& body = assembly.bodies[b];
    if (body.body.triangles.empty()) {  // of no part, and never asked for
      cut.of_body.push_back(0);
      continue;
    }
    const auto [key, name] = KeyOf(assembly, body, selection.scope);
    const auto [number, fresh] = numbers.emplace(key, cut.parts.size());
    if (fresh) {
      ReferencePart part;
      part.name = name;
      const bool file = selection.scope == PartScope::kFile;
      part.label = uint32_t(LastRule(selection.labels, name,
                                     file ? int64_t(assembly.files[body.file].label) : int64_t(number->second + 1)));
      part.priority = LastRule(selection.priorities, name, assembly.files[body.file].priority);
      cut.parts.push_back(part);
    }
    cut.parts[number->second].bodies.push_back(b);
    cut.of_body.push_back(number->second);
  }
  for (size_t p = 0; p < cut.parts.size(); ++p) {
    for (size_t q = 0; q < cut.parts.size(); ++q) {
      const int64_t a = cut.parts[p].priority, b = cut.parts[q].priority;
      if (b < a || (b == a && q < p)) ++cut.parts[p].rank;
    }
  }
  return cut;
}

}  // namespace voxelpipe::testing

#include "mesh/parts/part_list.h"

#include <algorithm>
#include <limits>
#include <memory>
#include <new>
#include <string>
#include <unordered_map>
#include <vector>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr size_t kRunsAStep = 1 << 14;     // between two polls of the job
constexpr uint64_t kBytesAStep = 1 << 16;  // compared bytes, the same
constexpr size_t kNamesShown = 8;
constexpr char kWhat[] = "the list of parts";
// Of a part: its entry, while the list grows by doubling, and its number by key.
constexpr uint64_t kPartBytes = 3 * sizeof(Part) + 64;

const PlacedEntry* EntryOf(const TriangleMesh& mesh, size_t run) {
  if (mesh.placed.empty()) return nullptr;
  const auto behind = std::upper_bound(mesh.placed.begin(), mesh.placed.end(), run,
                                       [](size_t r, const PlacedEntry& placed) { return r < placed.first_part; });
  return &*std::prev(behind);
}

// The names of the file of a run, and the run's node and mesh there.
struct NamedRun {
  const SceneNames* names = nullptr;
  uint32_t node = 0, mesh = 0;
};

NamedRun NamesOf(const TriangleMesh& mesh, size_t run) {
  const MeshPart& part = mesh.parts[run];
  const PlacedEntry* const placed = EntryOf(mesh, run);
  if (placed == nullptr) return {mesh.names.get(), part.node, part.mesh};
  return {placed->names.get(), part.node - placed->first_node, part.mesh - placed->first_mesh};
}

std::string_view NodeName(const TriangleMesh& mesh, size_t run) {
  const NamedRun of = NamesOf(mesh, run);
  if (of.names == nullptr || of.node >= of.names->named_by.size()) return "";
  return of.names->nodes[of.names->named_by[of.node]];
}

std::string_view MeshName(const TriangleMesh& mesh, size_t run) {
  const NamedRun of = NamesOf(mesh, run);
  if (of.names == nullptr || of.mesh >= of.names->meshes.size()) return "";
  return of.names->meshes[of.mesh];
}

uint32_t MaterialOf(const TriangleMesh& mesh, size_t run) {
  const int32_t material = mesh.parts[run].material;
  const size_t count = mesh.materials.size();
  return material >= 0 && size_t(material) < count ? uint32_t(material) : uint32_t(count);
}

std::string_view NameOf(const TriangleMesh& mesh, PartScope scope, size_t run) {
  switch (scope) {
    case PartScope::kWhole: return "";
    case PartScope::kFile: return EntryOf(mesh, run) == nullptr ? "" : std::string_view(EntryOf(mesh, run)->name);
    case PartScope::kNode: return NodeName(mesh, run);
    case PartScope::kMesh: return MeshName(mesh, run);
    case PartScope::kMaterial: {
      const uint32_t material = MaterialOf(mesh, run);
      return material < mesh.materials.size() ? std::string_view(mesh.materials[material].name) : "";
    }
  }
  return "";
}

// Numbers runs by what they belong to: equal numbers are one part.
class Keys {
 public:
  Keys(const TriangleMesh& mesh, PartScope scope) : mesh_(mesh), scope_(scope) {}
  // Call for all runs, in order.
  uint64_t Next(size_t run) {
    const MeshPart& part = mesh_.parts[run];
    switch (scope_) {
      case PartScope::kWhole: return 0;
      case PartScope::kFile: return mesh_.placed.empty() ? 0 : uint64_t(EntryOf(mesh_, run) - mesh_.placed.data());
      case PartScope::kNode: {
        // The runs of an instance follow each other by primitive.
        const bool same =
            run > 0 && mesh_.parts[run - 1].node == part.node && mesh_.parts[run - 1].primitive < part.primitive;
        if (!same) ++instance_;
        return instance_;
      }
      case PartScope::kMesh: return part.mesh;
      case PartScope::kMaterial: return MaterialOf(mesh_, run);
    }
    return 0;
  }

 private:
  const TriangleMesh& mesh_;
  const PartScope scope_;
  uint64_t instance_ = 0;
};

absl::Status CheckRules(const char* what, const std::vector<PartRule>& rules, int64_t min, int64_t max) {
  if (rules.size() > kMaxPartRules) {
    return absl::InvalidArgumentError(
        absl::StrCat("parts: ", rules.size(), " rules for ", what, "; at most ", kMaxPartRules, " are allowed"));
  }
  for (const PartRule& rule : rules) {
    if (rule.number >= min && rule.number <= max) continue;
    return absl::InvalidArgumentError(absl::StrCat("parts: the ", what, " ", rule.number, " of '", rule.pattern,
                                                   "' must be from ", min, " to ", max));
  }
  return absl::OkStatus();
}

absl::Status CheckSelection(const PartSelection& selection) {
  const bool rules = !selection.labels.empty() || !selection.priorities.empty() || !selection.exclude.empty();
  if (selection.scope == PartScope::kWhole && rules) {
    return absl::InvalidArgumentError("parts: rules and patterns need parts: file, node, mesh or material");
  }
  if (selection.exclude.size() > kMaxPartRules) {
    return absl::InvalidArgumentError(absl::StrCat("parts: ", selection.exclude.size(),
                                                   " patterns to exclude; at most ", kMaxPartRules, " are allowed"));
  }
  absl::Status s = CheckRules("label", selection.labels, 1, std::numeric_limits<uint32_t>::max());
  if (s.ok()) {
    s = CheckRules("priority", selection.priorities, std::numeric_limits<int32_t>::min(),
                   std::numeric_limits<int32_t>::max());
  }
  return s;
}

// The bytes of the character at the beginning of a text that is not empty.
size_t CharacterBytes(std::string_view text) {
  size_t bytes = 1;
  while (bytes < text.size() && (uint8_t(text[bytes]) & 0xc0) == 0x80) ++bytes;
  return bytes;
}

// Calls go_on() for each comparison, and ends with false as soon as it says so.
template <typename GoOn>
bool Match(std::string_view pattern, std::string_view name, const GoOn& go_on) {
  // The last * takes as little as it can; a mismatch behind it makes it take a byte more.
  size_t p = 0, n = 0, star = std::string_view::npos, resume = 0;
  while (n < name.size()) {
    if (!go_on()) return false;
    if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      resume = n;
    } else if (p < pattern.size() && pattern[p] == '?') {
      ++p;
      n += CharacterBytes(name.substr(n));
    } else if (p < pattern.size() && pattern[p] == name[n]) {
      ++p;
      ++n;
    } else if (star != std::string_view::npos) {
      p = star + 1;
      n = ++resume;
    } else {
      return false;
    }
  }
  while (p < pattern.size() && pattern[p] == '*') ++p;
  return p == pattern.size();
}

// Compares names with patterns, both untrusted input, while the job goes on: a long pattern takes as many steps as the
// product of the lengths.
class Matcher {
 public:
  explicit Matcher(const JobContext& job) : job_(job) {}
  // False too once the job is over.
  bool operator()(std::string_view pattern, std::string_view name) {
    GoOn();
    return Match(pattern, name, [this] { return GoOn(); });
  }
  const absl::Status& over() const { return over_; }

 private:
  bool GoOn() {
    if (++steps_ % kBytesAStep == 0 && over_.ok()) over_ = job_.Check();
    return over_.ok();
  }

  const JobContext& job_;
  uint64_t steps_ = 0;
  absl::Status over_;
};

// The first names of parts, each once, for warnings.
class KnownNames {
 public:
  void Add(std::string_view name) {
    if (seen_.size() > kNamesShown || std::find(seen_.begin(), seen_.end(), name) != seen_.end()) return;
    seen_.push_back(name);
  }
  std::string Text() const {
    std::string text;
    for (size_t i = 0; i < std::min(seen_.size(), kNamesShown); ++i) {
      absl::StrAppend(&text, i == 0 ? "" : ", ", "'", std::string(seen_[i]), "'");
    }
    if (seen_.empty()) text = "none";
    return seen_.size() > kNamesShown ? text + ", ..." : text;
  }

 private:
  std::vector<std::string_view> seen_;
};

// Warns of patterns that match no part.
void WarnOfUnmatched(const KnownNames& names, const std::vector<std::string_view>& patterns,
                     const std::vector<bool>& matched, WarningList& warnings) {
  for (size_t i = 0; i < patterns.size(); ++i) {
    if (matched[i]) continue;
    warnings.Add(WarningCode::kPartNotFound, "parts",
                 absl::StrCat("no part is called '", std::string(patterns[i]), "'; there are ", names.Text()));
  }
}

// The number of the last rule that matches, otherwise `own`; marks those that matched.
int64_t ByRules(Matcher& matches, const std::vector<PartRule>& rules, std::string_view name, int64_t own,
                std::vector<bool>& matched, size_t first) {
  int64_t number = own;
  for (size_t i = 0; i < rules.size(); ++i) {
    if (!matches(rules[i].pattern, name)) continue;
    number = rules[i].number;
    matched[first + i] = true;
  }
  return number;
}

absl::Status Number(const JobContext& job, const TriangleMesh& mesh, const PartSelection& selection, PartList& list) {
  const size_t labels = selection.labels.size(), priorities = selection.priorities.size();
  std::vector<bool> matched(labels + priorities);
  Matcher matches(job);
  for (size_t i = 0; i < list.parts.size() && matches.over().ok(); ++i) {
    Part& part = list.parts[i];
    const PlacedEntry* const placed = mesh.placed.empty() ? nullptr : &mesh.placed[part.placed];
    const bool of_file = selection.scope == PartScope::kFile && placed != nullptr;
    const int64_t own = of_file ? int64_t(placed->label) : int64_t(i + 1);
    part.label = uint32_t(ByRules(matches, selection.labels, part.name, own, matched, 0));
    const int64_t priority = placed == nullptr ? 0 : placed->priority;
    part.priority = int32_t(ByRules(matches, selection.priorities, part.name, priority, matched, labels));
  }
  if (!matches.over().ok()) return matches.over();
  std::vector<uint32_t> order(list.parts.size());
  for (uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(),
                   [&](uint32_t a, uint32_t b) { return list.parts[a].priority < list.parts[b].priority; });
  for (uint32_t i = 0; i < order.size(); ++i) list.parts[order[i]].rank = i;
  KnownNames names;
  for (const Part& part : list.parts) names.Add(part.name);
  std::vector<std::string_view> patterns;
  for (const auto* rules : {&selection.labels, &selection.priorities}) {
    for (const PartRule& rule : *rules) patterns.push_back(rule.pattern);
  }
  WarnOfUnmatched(names, patterns, matched, list.warnings);
  return absl::OkStatus();
}

// Lists the parts without their numbers.
absl::StatusOr<PartList> Cut(const JobContext& job, const TriangleMesh& mesh, PartScope scope) {
  PartList list;
  list.memory = std::make_shared<MemoryCharge>(&MemoryOf(job));
  if (absl::Status full = list.memory->Grow(mesh.parts.size(), sizeof(uint32_t), kWhat); !full.ok()) return full;
  list.of_run.resize(mesh.parts.size());
  std::unordered_map<uint64_t, uint32_t> numbers;
  Keys keys(mesh, scope);
  size_t entry = 0;
  for (size_t run = 0; run < mesh.parts.size(); ++run) {
    if (run % kRunsAStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    while (entry + 1 < mesh.placed.size() && mesh.placed[entry + 1].first_part <= run) ++entry;
    const uint64_t key = keys.Next(run);
    const MeshPart& part = mesh.parts[run];
    if (part.triangle_count == 0) continue;
    const auto [number, fresh] = numbers.try_emplace(key, uint32_t(numbers.size()));
    list.of_run[run] = number->second;
    if (fresh) {
      if (absl::Status full = list.memory->Grow(kPartBytes, kWhat); !full.ok()) return full;
      if (list.parts.size() == kMaxParts) continue;  // only counted
      Part added;
      added.name = NameOf(mesh, scope, run);
      added.first_triangle = part.first_triangle;
      added.placed = uint32_t(entry);
      list.parts.push_back(added);
    }
    if (number->second < list.parts.size()) list.parts[number->second].triangle_count += part.triangle_count;
  }
  if (numbers.size() > kMaxParts) {
    return absl::InvalidArgumentError(
        absl::StrCat("parts: the mesh has ", numbers.size(), " parts; at most ", kMaxParts, " are allowed"));
  }
  return list;
}

}  // namespace

bool MatchesPattern(std::string_view pattern, std::string_view name) {
  return Match(pattern, name, [] { return true; });
}

absl::StatusOr<PartList> ListParts(const JobContext& job, const TriangleMesh& mesh, const PartSelection& selection) {
  if (absl::Status s = CheckSelection(selection); !s.ok()) return s;
  try {
    absl::StatusOr<PartList> list = Cut(job, mesh, selection.scope);
    if (!list.ok()) return list;
    if (absl::Status s = Number(job, mesh, selection, *list); !s.ok()) return s;
    return list;
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory for the list of parts");
  }
}

absl::StatusOr<std::vector<bool>> ExcludedRuns(const JobContext& job, const TriangleMesh& mesh,
                                               const PartSelection& selection, WarningList& warnings) {
  if (absl::Status s = CheckSelection(selection); !s.ok()) return s;
  // A run's name is that of its part: nothing of parts has to be kept, of which there may be millions here.
  std::vector<bool> matched(selection.exclude.size()), out(mesh.parts.size());
  Matcher matches(job);
  KnownNames names;
  std::string_view last;
  bool last_out = false, any = false;
  for (size_t run = 0; run < out.size() && matches.over().ok(); ++run) {
    if (run % kRunsAStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    if (mesh.parts[run].triangle_count == 0) continue;
    const std::string_view name = NameOf(mesh, selection.scope, run);
    if (!any || name.data() != last.data() || name.size() != last.size()) {
      last_out = false;
      for (size_t e = 0; e < matched.size(); ++e) {
        if (!matches(selection.exclude[e], name)) continue;
        last_out = matched[e] = true;
      }
      names.Add(name);
      last = name;
      any = true;
    }
    out[run] = last_out;
  }
  if (!matches.over().ok()) return matches.over();
  WarnOfUnmatched(names, {selection.exclude.begin(), selection.exclude.end()}, matched, warnings);
  return out;
}

}  // namespace voxelpipe

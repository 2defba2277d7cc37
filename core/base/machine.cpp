// Sources: cgroups(7), proc_pid_mountinfo(5); the kernel's Documentation/admin-guide/cgroup-v2.rst (cpu.max,
// memory.max, memory.high) and cgroup-v1/memory.rst (memory.limit_in_bytes, hierarchical_memory_limit).
#include "base/machine.h"

#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <mutex>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace voxelpipe {
namespace {

using std::filesystem::path;

// A mounted hierarchy of control groups.
struct Mount {
  std::string group;  // the group at the mount point, as /proc/self/cgroup names it
  std::string point;
  bool second_version = false;
  std::vector<std::string> controllers;  // of version 1
};

// The bounds found so far.
struct Bounds {
  std::optional<double> cpus;
  path cpu_group;
  std::optional<uint64_t> bytes;
  path memory_group;

  void AddQuota(double quota, double period, const path& group) {
    if (!(quota > 0) || !(period > 0) || (cpus && *cpus <= quota / period)) return;
    cpus = quota / period;
    cpu_group = group;
  }
  void AddMemory(std::optional<uint64_t> bound, const path& group) {
    if (!bound || *bound == 0 || (bytes && *bytes <= *bound)) return;
    bytes = bound;
    memory_group = group;
  }
};

// Removes `prefix` from the front of `text`, if it is there.
bool TakePrefix(std::string_view& text, std::string_view prefix) {
  if (!text.starts_with(prefix)) return false;
  text.remove_prefix(prefix.size());
  return true;
}

std::vector<std::string> LinesOf(const path& file) {
  std::vector<std::string> lines;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) lines.push_back(std::move(line));
  return lines;
}

std::vector<std::string> WordsOf(const path& file) {
  std::ifstream in(file);
  return {std::istream_iterator<std::string>(in), {}};
}

// Absent for "max" and for text that is no number.
template <typename Number>
std::optional<Number> NumberOf(const std::string& text) {
  Number number;
  if (!absl::SimpleAtoi(text, &number)) return std::nullopt;
  return number;
}

template <typename Number>
std::optional<Number> NumberIn(const path& file) {
  const std::vector<std::string> words = WordsOf(file);
  return words.empty() ? std::nullopt : NumberOf<Number>(words[0]);
}

// The kernel writes blanks and backslashes of paths as \040 and the like.
std::string Unescaped(std::string_view text) {
  std::string out;
  for (size_t i = 0; i < text.size(); ++i) {
    int code = 0;
    const bool octal = text[i] == '\\' && i + 3 < text.size() &&
                       std::from_chars(&text[i + 1], &text[i + 1] + 3, code, 8).ptr == &text[i + 1] + 3;
    out += octal ? char(code) : text[i];
    if (octal) i += 3;
  }
  return out;
}

std::vector<Mount> MountsOf(const path& root) {
  std::vector<Mount> mounts;
  for (const std::string& line : LinesOf(root / "proc/self/mountinfo")) {
    const std::vector<std::string> words = absl::StrSplit(line, ' ');
    const auto dash = std::find(words.begin(), words.end(), "-");
    if (words.size() < 6 || std::distance(dash, words.end()) < 4) continue;
    const bool second = dash[1] == "cgroup2";
    if (!second && dash[1] != "cgroup") continue;
    mounts.push_back({Unescaped(words[3]), Unescaped(words[4]), second, absl::StrSplit(dash[3], ',')});
  }
  return mounts;
}

// This process's group in the hierarchy of version 2 or, of version 1, with this controller. Absent: there is no such
// hierarchy.
std::optional<std::string> GroupOf(const std::vector<std::string>& lines, bool second_version,
                                   std::string_view controller) {
  for (const std::string& line : lines) {  // "4:cpu,cpuacct:/a/b" or "0::/a/b"
    const std::vector<std::string> parts = absl::StrSplit(line, absl::MaxSplits(':', 2));
    if (parts.size() < 3) continue;
    const std::vector<std::string> controllers = absl::StrSplit(parts[1], ',');
    const bool found = second_version
                           ? parts[0] == "0" && parts[1].empty()
                           : std::find(controllers.begin(), controllers.end(), controller) != controllers.end();
    if (found) return parts[2];
  }
  return std::nullopt;
}

// Calls visit(directory, group's name) for the group and all its ancestors in the mount. In a container the path of the
// group may be that of the host and not exist here: then the mount point is the container's own group.
template <typename Visit>
void ForEachGroup(const path& root, const Mount& mount, std::string_view group, const Visit& visit) {
  std::string_view below = group;
  if (mount.group != "/" && (!TakePrefix(below, mount.group) || !(below.empty() || below[0] == '/'))) {
    below = "";
  }
  const path point(mount.point);
  path inside = path(below).relative_path();
  if (std::find(inside.begin(), inside.end(), "..") != inside.end()) inside.clear();
  while (true) {
    const path name = inside.empty() ? point : point / inside;
    visit(root / name.relative_path(), name);
    if (inside.empty()) return;
    inside = inside.parent_path();
  }
}

void AddSecondVersion(const path& directory, const path& name, Bounds& bounds) {
  // "150000 100000" or "max 100000"
  if (const std::vector<std::string> words = WordsOf(directory / "cpu.max"); words.size() >= 2) {
    bounds.AddQuota(NumberOf<int64_t>(words[0]).value_or(0), NumberOf<int64_t>(words[1]).value_or(0), name);
  }
  // Above memory.high the kernel throttles the process almost to a standstill.
  for (const char* file : {"memory.max", "memory.high"}) {
    bounds.AddMemory(NumberIn<uint64_t>(directory / file), name);
  }
}

void AddCpuOfFirstVersion(const path& directory, const path& name, Bounds& bounds) {
  bounds.AddQuota(NumberIn<int64_t>(directory / "cpu.cfs_quota_us").value_or(-1),
                  NumberIn<int64_t>(directory / "cpu.cfs_period_us").value_or(0), name);
}

void AddMemoryOfFirstVersion(const path& directory, const path& name, Bounds& bounds) {
  bounds.AddMemory(NumberIn<uint64_t>(directory / "memory.limit_in_bytes"), name);
  // It includes ancestors that are not visible from here.
  for (const std::string& line : LinesOf(directory / "memory.stat")) {
    std::string_view number = line;
    if (TakePrefix(number, "hierarchical_memory_limit ")) {
      bounds.AddMemory(NumberOf<uint64_t>(std::string(number)), name);
    }
  }
}

Bounds BoundsOf(const path& root) {
  Bounds bounds;
  const std::vector<std::string> groups = LinesOf(root / "proc/self/cgroup");
  for (const Mount& mount : MountsOf(root)) {
    const auto add = [&](std::string_view controller, void (*bound)(const path&, const path&, Bounds&)) {
      const std::optional<std::string> group = GroupOf(groups, mount.second_version, controller);
      if (!group) return;
      ForEachGroup(root, mount, *group,
                   [&](const path& directory, const path& name) { bound(directory, name, bounds); });
    };
    if (mount.second_version) {
      add("", AddSecondVersion);
      continue;
    }
    for (const std::string& controller : mount.controllers) {
      if (controller == "cpu") add(controller, AddCpuOfFirstVersion);
      if (controller == "memory") add(controller, AddMemoryOfFirstVersion);
    }
  }
  return bounds;
}

// The value of `key` in a file of lines "Key: value"; empty if there is none.
std::string ValueOf(const path& file, std::string_view key) {
  for (const std::string& line : LinesOf(file)) {
    if (!line.starts_with(key)) continue;
    std::string value = line.substr(key.size());
    absl::StripAsciiWhitespace(&value);
    return value;
  }
  return "";
}

// "0-3,8" -> 5. 0 if the text is no list.
int CountOfList(const std::string& list) {
  int64_t count = 0;
  const std::vector<std::string> parts = absl::StrSplit(list, ',', absl::SkipEmpty());
  for (const std::string& part : parts) {
    const std::vector<std::string> ends = absl::StrSplit(part, '-');
    const auto first = NumberOf<int64_t>(ends.front()), last = NumberOf<int64_t>(ends.back());
    if (!first || !last || *last < *first) return 0;
    count += *last - *first + 1;
  }
  return int(std::min<int64_t>(count, 1 << 20));
}

int AffinityOf(const path& root) {
  // Unlike the mask of sched_getaffinity, the list has no bound on the number of CPUs.
  if (const int cpus = CountOfList(ValueOf(root / "proc/self/status", "Cpus_allowed_list:")); cpus > 0) return cpus;
  cpu_set_t mask;
  if (sched_getaffinity(getpid(), sizeof mask, &mask) == 0) return std::max(1, CPU_COUNT(&mask));
  return std::max(1, int(std::thread::hardware_concurrency()));
}

uint64_t PhysicalBytes(const path& root) {
  const std::vector<std::string> words = absl::StrSplit(ValueOf(root / "proc/meminfo", "MemTotal:"), ' ');
  if (const auto kib = NumberOf<uint64_t>(words[0]); kib && *kib > 0) return *kib << 10;
  return uint64_t(sysconf(_SC_PHYS_PAGES)) * uint64_t(sysconf(_SC_PAGE_SIZE));
}

// With one decimal.
std::string MiB(uint64_t bytes) {
  const uint64_t tenths = (bytes * 10 + (1 << 19)) >> 20;
  return absl::StrCat(tenths / 10, ".", tenths % 10, " MiB");
}

// The values of the last read; 0: not read yet.
std::atomic<int> g_cpus{0};
std::atomic<uint64_t> g_memory_bytes{0};
std::mutex g_refresh_mutex;  // so that the last read wins

}  // namespace

MachineLimits ReadMachineLimits(const path& root) {
  const Bounds bounds = BoundsOf(root);
  MachineLimits limits;
  limits.affinity_cpus = limits.cpus = AffinityOf(root);
  if (bounds.cpus) {
    limits.quota_cpus = *bounds.cpus;
    limits.quota_group = bounds.cpu_group;
    // The rounding of the division must not turn 2 CPUs into 3.
    limits.cpus = int(std::min(double(limits.cpus), std::max(1.0, std::ceil(*bounds.cpus - 1e-6))));
  }
  limits.physical_bytes = PhysicalBytes(root);
  uint64_t bytes = limits.physical_bytes;
  if (bounds.bytes && *bounds.bytes < bytes) {
    limits.bound_bytes = bytes = *bounds.bytes;
    limits.bound_group = bounds.memory_group;
  }
  limits.memory_bytes = bytes / 10 * 9;
  return limits;
}

std::string ToString(const MachineLimits& limits) {
  std::string text =
      absl::StrCat(limits.cpus, limits.cpus == 1 ? " CPU" : " CPUs", " (affinity ", limits.affinity_cpus);
  if (limits.quota_cpus > 0) {
    absl::StrAppend(&text, ", quota ", limits.quota_cpus, " by ", limits.quota_group);
  }
  absl::StrAppend(&text, "), ", MiB(limits.memory_bytes), " of memory (9/10 of ");
  if (limits.bound_bytes > 0) {
    absl::StrAppend(&text, MiB(limits.bound_bytes), " by ", limits.bound_group, ")");
  } else {
    absl::StrAppend(&text, "the machine's ", MiB(limits.physical_bytes), ")");
  }
  return text;
}

int CpuCount() {
  const int cpus = g_cpus.load(std::memory_order_relaxed);
  return cpus > 0 ? cpus : RefreshMachine().cpus;
}

uint64_t MemoryBytes() {
  const uint64_t bytes = g_memory_bytes.load(std::memory_order_relaxed);
  return bytes > 0 ? bytes : RefreshMachine().memory_bytes;
}

MachineLimits RefreshMachine() {
  const std::lock_guard lock(g_refresh_mutex);
  MachineLimits limits = ReadMachineLimits();
  g_cpus.store(limits.cpus, std::memory_order_relaxed);
  g_memory_bytes.store(limits.memory_bytes, std::memory_order_relaxed);
  return limits;
}

}  // namespace voxelpipe

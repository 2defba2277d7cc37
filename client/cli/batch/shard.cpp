#include "batch/shard.h"

#include <charconv>
#include <cstdlib>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace voxelpipe::cli {
namespace {

constexpr char kSlurmTask[] = "SLURM_ARRAY_TASK_ID", kSlurmFirst[] = "SLURM_ARRAY_TASK_MIN",
               kSlurmCount[] = "SLURM_ARRAY_TASK_COUNT", kSlurmStep[] = "SLURM_ARRAY_TASK_STEP",
               kPodIndex[] = "JOB_COMPLETION_INDEX", kPodCount[] = "VOXELPIPE_SHARDS";

template <typename... Parts>
absl::Status Wrong(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat("--shard: ", parts...));
}

// Whole numbers of the environment. An empty variable is one that is not set: manifests and scripts leave such behind.
class Variables {
 public:
  explicit Variables(const Environment& environment) : environment_(environment) {}

  bool Has(const char* name) const {
    const std::optional<std::string> text = environment_(name);
    return text && !text->empty();
  }
  absl::StatusOr<uint64_t> Number(const char* name) const {
    const std::string text = environment_(name).value_or("");
    uint64_t number = 0;
    if (absl::SimpleAtoi(text, &number)) return number;
    return Wrong("auto: ", name, "='", text, "' is no number from 0 on");
  }
  // INVALID_ARGUMENT naming those that are not set.
  absl::Status Need(const std::vector<const char*>& names, const char* present, const char* advice) const {
    std::vector<const char*> missing;
    for (const char* name : names) {
      if (!Has(name)) missing.push_back(name);
    }
    if (missing.empty()) return absl::OkStatus();
    return Wrong("auto: ", present, " is set, but ", absl::StrJoin(missing, " and "),
                 missing.size() == 1 ? " is not" : " are not", advice);
  }

 private:
  const Environment& environment_;
};

absl::StatusOr<Shard> OfSlurm(const Variables& variables) {
  if (absl::Status s = variables.Need({kSlurmFirst, kSlurmCount}, kSlurmTask, "; Slurm sets them for array jobs");
      !s.ok()) {
    return s;
  }
  const absl::StatusOr<uint64_t> task = variables.Number(kSlurmTask), first = variables.Number(kSlurmFirst),
                                 count = variables.Number(kSlurmCount);
  for (const absl::StatusOr<uint64_t>* number : {&task, &first, &count}) {
    if (!number->ok()) return number->status();
  }
  uint64_t step = 1;
  if (variables.Has(kSlurmStep)) {
    const absl::StatusOr<uint64_t> given = variables.Number(kSlurmStep);
    if (!given.ok()) return given.status();
    if (*given > 0) step = *given;
  }
  const bool in_steps = *task >= *first && (*task - *first) % step == 0;
  const uint64_t index = in_steps ? (*task - *first) / step : *count;
  if (index < *count) return Shard{index, *count};
  return Wrong("auto: task ", *task, " is not among ", *count, " tasks from ", *first, " on (", kSlurmTask, ", ",
               kSlurmCount, ", ", kSlurmFirst, "); give an array without gaps, --array=0-N, or --shard i/n");
}

absl::StatusOr<Shard> OfPod(const Variables& variables) {
  if (absl::Status s = variables.Need({kPodCount}, kPodIndex, "; set it to the completions of the Job"); !s.ok()) {
    return s;
  }
  const absl::StatusOr<uint64_t> index = variables.Number(kPodIndex), count = variables.Number(kPodCount);
  if (!index.ok()) return index.status();
  if (!count.ok()) return count.status();
  if (*index < *count) return Shard{*index, *count};
  return Wrong("auto: ", kPodIndex, "=", *index, " is not below ", kPodCount, "=", *count);
}

absl::StatusOr<Shard> OfEnvironment(const Variables& variables) {
  const bool slurm = variables.Has(kSlurmTask), pod = variables.Has(kPodIndex);
  if (slurm && pod) return Wrong("auto: both ", kSlurmTask, " and ", kPodIndex, " are set; give --shard i/n");
  if (slurm) return OfSlurm(variables);
  if (pod) return OfPod(variables);
  return Wrong("auto: neither ", kSlurmTask, " (an array job of Slurm) nor ", kPodIndex,
               " (an Indexed Job of Kubernetes) is set; give --shard i/n");
}

}  // namespace

std::optional<std::string> ProcessEnvironment(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? std::nullopt : std::optional<std::string>(value);
}

absl::StatusOr<Shard> ParseShard(const std::string& text, const Environment& environment) {
  if (text == "auto") return OfEnvironment(Variables(environment));
  Shard shard;
  const char* const end = text.data() + text.size();
  const auto [slash, first] = std::from_chars(text.data(), end, shard.index);
  const bool has_slash = first == std::errc() && slash != end && *slash == '/';
  if (has_slash) {
    const auto [stop, second] = std::from_chars(slash + 1, end, shard.count);
    if (second == std::errc() && stop == end && shard.count >= 1 && shard.index <= shard.count) return shard;
  }
  return Wrong("'", text, "' is not of the form i/n with i from 0 to n, and not auto");
}

}  // namespace voxelpipe::cli

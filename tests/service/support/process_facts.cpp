#include "service/support/process_facts.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "service/support/server_process.h"

namespace voxelpipe::testing {

std::string ProcessFacts::ToString() const {
  std::ostringstream text;
  text << descriptors << " descriptors, " << threads << " threads, " << (resident_bytes >> 10) << " KiB resident, "
       << (peak_bytes >> 10) << " KiB at the most";
  return text.str();
}

ProcessFacts ReadProcessFacts(pid_t pid) {
  ProcessFacts facts;
  const std::filesystem::path folder = "/proc/" + std::to_string(pid);
  std::error_code error;
  for (auto it = std::filesystem::directory_iterator(folder / "fd", error);
       !error && it != std::filesystem::directory_iterator(); it.increment(error)) {
    ++facts.descriptors;
  }
  std::ifstream status(folder / "status");
  for (std::string key; status >> key;) {
    if (key == "Threads:") {
      status >> facts.threads;
    } else if (key == "VmRSS:" || key == "VmHWM:") {
      uint64_t kib = 0;
      status >> kib;
      (key == "VmRSS:" ? facts.resident_bytes : facts.peak_bytes) = kib << 10;
    }
    status.ignore(1 << 20, '\n');
  }
  return facts;
}

std::vector<pid_t> ChildrenOf(pid_t pid) {
  std::vector<pid_t> children;
  std::error_code error;
  for (auto it = std::filesystem::directory_iterator("/proc", error);
       !error && it != std::filesystem::directory_iterator(); it.increment(error)) {
    const std::string name = it->path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::ifstream file(it->path() / "stat");
    std::string line;
    std::getline(file, line);
    // "PID (NAME) STATE PARENT ..."
    const size_t end = line.rfind(')');
    if (end == std::string::npos) continue;
    std::istringstream rest(line.substr(end + 1));
    char state = 0;
    pid_t parent = 0;
    if (rest >> state >> parent && parent == pid && state != 'Z') children.push_back(pid_t(std::stol(name)));
  }
  return children;
}

ProcessFacts SettledProcessFacts(pid_t pid) {
  constexpr std::chrono::milliseconds kUnchanged{500 * kSlowdown};
  using Clock = std::chrono::steady_clock;
  const auto give_up = Clock::now() + kPatience;
  ProcessFacts facts = ReadProcessFacts(pid);
  for (auto since = Clock::now(); Clock::now() - since < kUnchanged && Clock::now() < give_up;) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    const ProcessFacts now = ReadProcessFacts(pid);
    const uint64_t more = std::max(now.resident_bytes, facts.resident_bytes),
                   less = std::min(now.resident_bytes, facts.resident_bytes);
    if (now.descriptors != facts.descriptors || now.threads != facts.threads || more - less > (1 << 20)) {
      since = Clock::now();
    }
    facts = now;
  }
  return facts;
}

bool IsSanitized(pid_t pid) {
  std::ifstream maps("/proc/" + std::to_string(pid) + "/maps");
  for (std::string line; std::getline(maps, line);) {
    if (line.find("/libasan.so") != std::string::npos || line.find("/libtsan.so") != std::string::npos) return true;
  }
  return false;
}

}  // namespace voxelpipe::testing

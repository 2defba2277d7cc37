#include "observe/process_metrics.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <system_error>

#include <prometheus/collectable.h>
#include <prometheus/metric_family.h>

namespace voxelpipe {
namespace {

using prometheus::MetricFamily;
using prometheus::MetricType;

MetricFamily Family(const char* name, const char* help, MetricType type, double value) {
  prometheus::ClientMetric metric;
  if (type == MetricType::Counter) {
    metric.counter.value = value;
  } else {
    metric.gauge.value = value;
  }
  return {name, help, type, {metric}};
}

std::optional<double> ResidentBytes() {
  std::ifstream file("/proc/self/statm");
  double size = 0, resident = 0;
  if (!(file >> size >> resident)) return std::nullopt;
  return resident * double(sysconf(_SC_PAGESIZE));
}

std::optional<double> EntriesOf(const char* folder) {
  std::error_code error;
  const std::filesystem::directory_iterator begin(folder, error);
  if (error) return std::nullopt;
  return double(std::distance(begin, std::filesystem::directory_iterator()));
}

class ProcessMetrics final : public prometheus::Collectable {
 public:
  std::vector<MetricFamily> Collect() const override {
    std::vector<MetricFamily> all;
    const auto add = [&](const char* name, const char* help, MetricType type, std::optional<double> value) {
      if (value) all.push_back(Family(name, help, type, *value));
    };
    rusage usage{};
    if (getrusage(RUSAGE_SELF, &usage) == 0) {
      const auto seconds = [](const timeval& time) { return double(time.tv_sec) + double(time.tv_usec) * 1e-6; };
      add("process_cpu_seconds_total", "User and system CPU time", MetricType::Counter,
          seconds(usage.ru_utime) + seconds(usage.ru_stime));
    }
    add("process_resident_memory_bytes", "Resident memory", MetricType::Gauge, ResidentBytes());
    add("process_open_fds", "Open file descriptors", MetricType::Gauge, EntriesOf("/proc/self/fd"));
    add("process_threads", "Threads", MetricType::Gauge, EntriesOf("/proc/self/task"));
    rlimit files{};
    if (getrlimit(RLIMIT_NOFILE, &files) == 0) {
      add("process_max_fds", "Limit of file descriptors", MetricType::Gauge, double(files.rlim_cur));
    }
    add("process_start_time_seconds", "When the server started, seconds since 1970", MetricType::Gauge, start_);
    return all;
  }

 private:
  const double start_ = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
};

}  // namespace

std::unique_ptr<prometheus::Collectable> MakeProcessMetrics() {
  return std::make_unique<ProcessMetrics>();
}

}  // namespace voxelpipe

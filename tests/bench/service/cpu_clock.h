// CPU time of processes, in total and over a measured span.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <ctime>

namespace voxelpipe::bench {

// CPU seconds of the process, all threads; 0 if it has ended.
inline double CpuSeconds(pid_t pid) {
  clockid_t clock;
  timespec time{};
  if (clock_getcpuclockid(pid, &clock) != 0 || clock_gettime(clock, &time) != 0) return 0;
  return double(time.tv_sec) + double(time.tv_nsec) * 1e-9;
}

// One span of a server and of this process, its client.
struct Measured {
  double seconds = 0, server_cpu = 0, client_cpu = 0;
  double requests = 0, bytes = 0;

  double cpu_us_per_request() const { return (server_cpu + client_cpu) * 1e6 / requests; }
  double gigabytes_per_second() const { return bytes / seconds * 1e-9; }
};

class Span {
 public:
  explicit Span(pid_t server) : server_(server), server_cpu_(CpuSeconds(server)), client_cpu_(CpuSeconds(0)) {}

  Measured End(double requests, double bytes) const {
    const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - begin_;
    return {wall.count(), CpuSeconds(server_) - server_cpu_, CpuSeconds(0) - client_cpu_, requests, bytes};
  }

 private:
  const pid_t server_;
  const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  const double server_cpu_, client_cpu_;
};

}  // namespace voxelpipe::bench

// Metrics of this process, with the names of Prometheus' client libraries.
#pragma once

#include <memory>

namespace prometheus {
class Collectable;
}

namespace voxelpipe {

// process_cpu_seconds_total, process_resident_memory_bytes, process_open_fds, process_max_fds, process_threads and
// process_start_time_seconds, read from /proc at every Collect. Values that cannot be read are left out.
std::unique_ptr<prometheus::Collectable> MakeProcessMetrics();

}  // namespace voxelpipe

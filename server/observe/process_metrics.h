// Figures of this process, as Prometheus' clients name them.
#pragma once

#include <memory>

namespace prometheus {
class Collectable;
}

namespace voxelpipe {

// process_cpu_seconds_total, process_resident_memory_bytes, process_open_fds, process_max_fds, process_threads and
// process_start_time_seconds, read from /proc at every Collect. What cannot be read is left out.
std::unique_ptr<prometheus::Collectable> MakeProcessMetrics();

}  // namespace voxelpipe

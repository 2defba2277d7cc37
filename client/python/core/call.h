// What all calls from Python share: errors, and work on another thread that Ctrl-C ends.
#pragma once

#include <pybind11/pybind11.h>

#include <functional>

#include "absl/status/status.h"

namespace voxelpipe {

// The Python exception voxelpipe_core.Failed: one argument, a google.rpc.Status as bytes.
pybind11::object& FailedType();

// Raises Failed; OSError for an error of writing a file.
[[noreturn]] void Throw(const absl::Status& status);

// Runs `work` on a thread of job_threads.h, without the GIL, and waits for it. `work` must not throw. A signal handler
// that raises (Ctrl-C) makes `cancel` be called; its exception is raised after the work has ended.
void RunInterruptible(const std::function<void()>& cancel, const std::function<void()>& work);

}  // namespace voxelpipe

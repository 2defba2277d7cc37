#include "call.h"

#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>

#include "encode/atomic_file.h"
#include "job_threads.h"
#include "wire/status.h"

namespace voxelpipe {

namespace py = pybind11;

constexpr std::chrono::milliseconds kPoll{20};  // between two looks for Ctrl-C

py::object& FailedType() {
  static auto* const type = new py::object();  // never destroyed: the interpreter ends first
  return *type;
}

void Throw(const absl::Status& status) {
  const grpc::Status with_details = ToGrpcStatus(status);
  if (!IsOutputError(status)) {
    PyErr_SetObject(FailedType().ptr(), py::bytes(with_details.error_details()).ptr());
    throw py::error_already_set();
  }
  // With a number Python chooses the class: FileNotFoundError, PermissionError, ...
  const int number = absl::IsAlreadyExists(status) ? EEXIST : OutputErrno(status);
  const py::str text(with_details.error_message());
  const py::object arguments = number == 0 ? py::make_tuple(text) : py::make_tuple(number, text);
  PyErr_SetObject(PyExc_OSError, arguments.ptr());
  throw py::error_already_set();
}

void RunInterruptible(const std::function<void()>& cancel, const std::function<void()>& work) {
  bool interrupted = false;
  {
    const py::gil_scoped_release no_gil;
    std::mutex mutex;
    std::condition_variable ended;
    bool done = false;
    RunOnJobThread(work, [&] {
      const std::lock_guard lock(mutex);
      done = true;
      ended.notify_one();
    });
    std::unique_lock lock(mutex);
    while (!ended.wait_for(lock, kPoll, [&] { return done; })) {
      if (interrupted) continue;
      lock.unlock();
      {
        const py::gil_scoped_acquire gil;
        interrupted = PyErr_CheckSignals() != 0;
      }
      if (interrupted) cancel();
      lock.lock();
    }
  }
  if (interrupted) throw py::error_already_set();
}

}  // namespace voxelpipe

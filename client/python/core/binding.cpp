// voxelpipe_core._core: runs requests in this process, and writes files of results (files.h). Speaks the service's
// messages, so that the package voxelpipe reads requests, results, summaries and errors by the same code as those of a
// server.
#include <pybind11/functional.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <dlpack/dlpack.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "call.h"
#include "files.h"
#include "load/load_mesh.h"
#include "mesh/report.h"
#include "pipeline/voxelize.h"
#include "shaders/catalog.h"
#include "wire/request.h"
#include "wire/response.h"
#include "wire/status.h"

namespace py = pybind11;

namespace voxelpipe {
namespace {

constexpr char kUnused[] = "dltensor";  // DLPack's name of a capsule that no consumer has taken yet

struct Outcome {
  VoxelizeResult result;
  MeshReport report;
  bool examined = false;  // degenerate triangles and open edges were counted
  std::vector<std::pair<std::string, double>> mesh_stages;
  uint64_t peak_bytes = 0;
};

absl::StatusOr<Outcome> Voxelize(const ParsedConfig& config, std::span<const uint8_t> file, const JobContext& job,
                                 bool on_device) {
  try {
    const VoxelizeRequest& request = config.request;
    if (on_device && request.result != ResultKind::kDense) {
      return absl::FailedPreconditionError(
          absl::StrCat("on the device: only dense results stay on a GPU, not ", std::string(Name(request.result))));
    }
    absl::StatusOr<LoadedMesh> loaded = LoadMeshFor(job, file, {config.mesh_type, TexturesRead(request), {}});
    if (!loaded.ok()) return OfMesh(loaded.status());
    Outcome outcome;
    outcome.mesh_stages = {{"load", loaded->load_ms}, {"flatten", loaded->flatten_ms}};
    outcome.peak_bytes = loaded->peak_bytes;
    outcome.examined = request.fill != Fill::kNone;
    const absl::StatusOr<MeshReport> report =
        outcome.examined ? ReportMesh(job, loaded->mesh) : BoxReport(job, loaded->mesh);
    if (!report.ok()) return report.status();
    outcome.report = *report;
    const PlanLimits limits = LimitsInProcess(job);
    absl::StatusOr<VoxelizeResult> result =
        voxelpipe::Voxelize(loaded->mesh, request, {.job = job, .limits = limits, .on_device = on_device});
    if (!result.ok()) return result.status();
    if (on_device && result->device_targets.empty()) {
      return absl::FailedPreconditionError(absl::StrCat(
          "on the device: the grid ", result->grid.dims[0], "x", result->grid.dims[1], "x", result->grid.dims[2],
          " was made in several slabs, so that the result is in this machine's memory"));
    }
    outcome.result = *std::move(result);
    return outcome;
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory");
  }
}

// A flat array of bytes that owns the buffer: no copy.
py::array_t<uint8_t> Owned(HostBuffer buffer) {
  auto* const owned = new HostBuffer(std::move(buffer));
  const py::capsule owner(owned, [](void* p) { delete static_cast<HostBuffer*>(p); });
  return py::array_t<uint8_t>(py::ssize_t(owned->size()), owned->data(), owner);
}

// A DLPack capsule of an array in a GPU's memory, which keeps that memory until its consumer is done. In: the type code
// and bits of an element, and the shape in C order.
py::object DlpackOf(const DeviceBuffer& buffer, int code, int bits, std::vector<int64_t> shape) {
  struct Managed {
    DLManagedTensor tensor;
    std::vector<int64_t> shape;
    std::shared_ptr<void> owner;
  };
  auto* const managed = new Managed{{}, std::move(shape), buffer.owner};
  DLTensor& tensor = managed->tensor.dl_tensor;
  tensor.data = buffer.data;
  tensor.device = {kDLCUDA, buffer.ordinal};
  tensor.ndim = int(managed->shape.size());
  tensor.dtype = {uint8_t(code), uint8_t(bits), 1};
  tensor.shape = managed->shape.data();
  tensor.strides = nullptr;  // dense, C order
  tensor.byte_offset = 0;
  managed->tensor.manager_ctx = managed;
  managed->tensor.deleter = [](DLManagedTensor* self) { delete static_cast<Managed*>(self->manager_ctx); };
  PyObject* const capsule = PyCapsule_New(&managed->tensor, kUnused, [](PyObject* self) {
    if (PyCapsule_IsValid(self, kUnused) == 0) return;
    auto* const unused = static_cast<DLManagedTensor*>(PyCapsule_GetPointer(self, kUnused));
    unused->deleter(unused);
  });
  if (capsule == nullptr) {
    delete managed;
    throw py::error_already_set();
  }
  return py::reinterpret_steal<py::object>(capsule);
}

py::tuple Answer(Outcome outcome) {
  VoxelizeResult& result = outcome.result;
  const v1::ResultHeader header = ToMessage(HeaderOf(result));
  v1::Summary summary;
  result.stats.stages.insert(result.stats.stages.begin(), outcome.mesh_stages.begin(), outcome.mesh_stages.end());
  WriteTo(result.stats, *summary.mutable_stats());
  WriteTo(outcome.report, outcome.examined, *summary.mutable_mesh());
  WriteWarnings(result.stats.warnings, summary);
  summary.set_peak_bytes(outcome.peak_bytes);
  summary.set_result_bytes(result.bytes());
  std::vector<HostBuffer*> in_order;  // stream order: result.h
  if (result.kind == ResultKind::kSparse) in_order = {&result.bricks, &result.masks};
  if (result.kind == ResultKind::kBuckets) in_order = {&result.voxels, &result.offsets, &result.triangles};
  for (HostBuffer& target : result.targets) in_order.push_back(&target);
  py::list arrays;
  for (HostBuffer* buffer : in_order) arrays.append(Owned(std::move(*buffer)));
  for (DeviceBuffer& buffer : result.device_targets) arrays.append(std::move(buffer));
  return py::make_tuple(py::bytes(header.SerializeAsString()), arrays, py::bytes(summary.SerializeAsString()));
}

// Runs one request. In: a VoxelizeConfig as bytes; the bytes of a mesh file without references to others; seconds until
// the deadline, or None; callable(stage, fraction) or None, called from another thread. Out: a ResultHeader as bytes,
// the arrays in stream order as flat bytes that own their memory, a Summary as bytes. Raises Failed; whatever the
// callable or a signal handler raises, after the job has ended. The GIL is released meanwhile. `on_device`: the arrays
// are DeviceBuffer objects; FAILED_PRECONDITION if the result cannot stay on a GPU.
py::tuple Run(const std::string& config_bytes, const py::buffer& mesh, std::optional<double> timeout,
              const py::object& progress, bool on_device) {
  v1::VoxelizeConfig message;
  if (!message.ParseFromString(config_bytes)) Throw(absl::InvalidArgumentError("config: is no VoxelizeConfig"));
  const absl::StatusOr<ParsedConfig> config = ParseConfig(message);
  if (!config.ok()) Throw(config.status());
  const py::buffer_info info = mesh.request();
  const std::span<const uint8_t> file(static_cast<const uint8_t*>(info.ptr), size_t(info.size * info.itemsize));

  std::optional<py::error_already_set> raised;  // by the callable; guarded by the GIL
  JobContext* running = nullptr;
  JobContext job([&](std::string_view stage, double fraction) {
    if (progress.is_none()) return;
    const py::gil_scoped_acquire gil;
    if (raised) return;
    try {
      progress(py::str(stage.data(), stage.size()), fraction);
    } catch (py::error_already_set& error) {
      raised.emplace(std::move(error));
      running->Cancel();
    }
  });
  running = &job;
  if (timeout) {
    const double seconds = std::clamp(*timeout, 0.0, 1e9);
    job.set_deadline(JobContext::Clock::now() +
                     std::chrono::duration_cast<JobContext::Clock::duration>(std::chrono::duration<double>(seconds)));
  }

  absl::StatusOr<Outcome> outcome = absl::UnknownError("the job did not run");
  RunInterruptible(job, [&] { outcome = Voxelize(*config, file, job, on_device); });
  if (raised) throw std::move(*raised);
  if (!outcome.ok()) Throw(outcome.status());
  return Answer(*std::move(outcome));
}

// All shaders, as a ListShadersResponse in bytes.
py::bytes Shaders() {
  v1::ListShadersResponse response;
  for (const ShaderInfo& shader : ListShaders()) *response.add_shaders() = ToMessage(shader);
  return response.SerializeAsString();
}

}  // namespace
}  // namespace voxelpipe

PYBIND11_MODULE(_core, module) {
  module.doc() = "VoxelPipe's core in this process; used by the package voxelpipe.";
  PyObject* const failed = PyErr_NewExceptionWithDoc("voxelpipe_core.Failed", "A google.rpc.Status as bytes, args[0].",
                                                     PyExc_RuntimeError, nullptr);
  voxelpipe::FailedType() = py::reinterpret_steal<py::object>(failed);
  module.attr("Failed") = voxelpipe::FailedType();
  py::class_<voxelpipe::DeviceBuffer>(module, "DeviceBuffer")
      .def_property_readonly("pointer", [](const voxelpipe::DeviceBuffer& b) { return uintptr_t(b.data); })
      .def_readonly("size", &voxelpipe::DeviceBuffer::size)
      .def_readonly("ordinal", &voxelpipe::DeviceBuffer::ordinal)
      .def("dlpack", &voxelpipe::DlpackOf, py::arg("code"), py::arg("bits"), py::arg("shape"));
  module.def("run", &voxelpipe::Run, py::arg("config"), py::arg("mesh"), py::arg("timeout"), py::arg("progress"),
             py::arg("on_device") = false);
  module.def("shaders", &voxelpipe::Shaders);
  module.def("formats", &voxelpipe::Formats);
  module.def("not_kept", &voxelpipe::NotKept, py::arg("config"), py::arg("header"), py::arg("path"));
  module.def("write", &voxelpipe::WriteFile, py::arg("config"), py::arg("header"), py::arg("arrays"), py::arg("path"));
}

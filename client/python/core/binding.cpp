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
#include <deque>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "call.h"
#include "files.h"
#include "mesh/health/health_facts.h"
#include "mesh_source.h"
#include "runs.h"
#include "shaders/catalog.h"
#include "wire/request.h"
#include "wire/response.h"
#include "wire/status.h"

namespace py = pybind11;

namespace voxelpipe {
namespace {

constexpr char kUnused[] = "dltensor";  // DLPack's name of a capsule that no consumer has taken yet

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
    std::vector<int64_t> shape, strides;
    std::shared_ptr<void> owner;
  };
  std::vector<int64_t> strides(shape.size(), 1);  // dense, C order
  for (size_t i = shape.size(); i > 1; --i) strides[i - 2] = strides[i - 1] * shape[i - 1];
  auto* const managed = new Managed{{}, std::move(shape), std::move(strides), buffer.owner};
  DLTensor& tensor = managed->tensor.dl_tensor;
  tensor.data = buffer.data;
  tensor.device = {kDLCUDA, buffer.ordinal};
  tensor.ndim = int(managed->shape.size());
  tensor.dtype = {uint8_t(code), uint8_t(bits), 1};
  tensor.shape = managed->shape.data();
  tensor.strides = managed->strides.data();  // DLPack 1.1 and later allow no null
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

// In: what the outcome was made for.
py::tuple Answer(Outcome outcome, const VoxelizeRequest& request) {
  VoxelizeResult& result = outcome.result;
  const v1::ResultHeader header = ToMessage(HeaderOf(result), request);
  v1::Summary summary;
  result.stats.stages.insert(result.stats.stages.begin(), outcome.mesh_stages.begin(), outcome.mesh_stages.end());
  WriteTo(result.stats, *summary.mutable_stats());
  WriteTo(outcome.report, outcome.examined, *summary.mutable_report());
  WriteWarnings(result.stats.warnings, summary);
  summary.set_peak_bytes(int64_t(outcome.peak_bytes));
  summary.set_result_bytes(int64_t(result.bytes() + result.parts.bytes()));
  std::vector<HostBuffer*> in_order;  // stream order: result.h
  if (result.kind == ResultKind::kSparse) in_order = {&result.bricks, &result.masks};
  if (result.kind == ResultKind::kBuckets) in_order = {&result.voxels, &result.offsets, &result.triangles};
  for (HostBuffer& target : result.targets) in_order.push_back(&target);
  py::list arrays;
  for (HostBuffer* buffer : in_order) arrays.append(Owned(std::move(*buffer)));
  for (DeviceBuffer& buffer : result.device_targets) arrays.append(std::move(buffer));
  for (const std::span<const uint8_t> array : ArraysOf(result.parts)) {
    arrays.append(py::array_t<uint8_t>(py::ssize_t(array.size()), array.data()));  // a copy
  }
  return py::make_tuple(py::bytes(header.SerializeAsString()), arrays, py::bytes(summary.SerializeAsString()));
}

// The request in a message's bytes.
ParsedConfig Parsed(const std::string& bytes) {
  v1::VoxelizeRequest message;
  if (!message.ParseFromString(bytes)) Throw(absl::InvalidArgumentError("request: is no VoxelizeRequest"));
  absl::StatusOr<ParsedConfig> request = ParseRequest(message);
  if (!request.ok()) Throw(request.status());
  return *std::move(request);
}

// In: a MeshFormat and a LengthUnit.
MeshFileType TypeOf(int format, int unit) {
  const absl::StatusOr<MeshFileType> type = ParseMeshType(v1::MeshFormat(format), v1::LengthUnit(unit), "");
  if (!type.ok()) Throw(type.status());
  return *type;
}

// A contiguous buffer, held while it is read.
struct Buffer {
  explicit Buffer(const py::handle& object) : info(py::cast<py::buffer>(object).request()) {}
  std::span<const uint8_t> bytes() const {
    return {static_cast<const uint8_t*>(info.ptr), size_t(info.size * info.itemsize)};
  }
  py::buffer_info info;
};

// The sources of a call's meshes and the buffers that they refer to.
class Sources {
 public:
  // In: a HeldMesh, a buffer with the bytes of a mesh file of this type, or a list of several HeldMesh; new positions,
  // or None.
  void Add(const py::handle& mesh, MeshFileType type, const py::object& positions) {
    MeshSource& source = sources_.emplace_back();
    source.type = type;
    if (py::isinstance<py::list>(mesh)) {
      for (const py::handle one : mesh) source.several.push_back(py::cast<std::shared_ptr<HeldMesh>>(one));
    } else if (py::isinstance<HeldMesh>(mesh)) {
      source.held = py::cast<std::shared_ptr<HeldMesh>>(mesh);
    } else {
      source.file = buffers_.emplace_back(mesh).bytes();
    }
    if (!positions.is_none()) source.positions = buffers_.emplace_back(positions).bytes();
  }
  const std::vector<MeshSource>& list() const { return sources_; }

 private:
  std::vector<MeshSource> sources_;
  std::deque<Buffer> buffers_;  // which stay where they are
};

void SetTimeout(JobContext& job, std::optional<double> timeout) {
  if (!timeout) return;
  const double seconds = std::clamp(*timeout, 0.0, 1e9);
  job.set_deadline(JobContext::Clock::now() +
                   std::chrono::duration_cast<JobContext::Clock::duration>(std::chrono::duration<double>(seconds)));
}

// One job of Python: its deadline, and its progress, a callable(stage, fraction) or None. What the callable raises ends
// the job and is raised at the end.
class PythonJob {
 public:
  PythonJob(std::optional<double> timeout, py::object progress)
      : progress_(std::move(progress)),
        job_([this](std::string_view stage, double fraction) { Tell(stage, fraction); }) {
    SetTimeout(job_, timeout);
  }
  JobContext& job() { return job_; }
  void Run(const std::function<void()>& work) {
    RunInterruptible([this] { job_.Cancel(); }, work);
    if (raised_) throw std::move(*raised_);
  }

 private:
  void Tell(std::string_view stage, double fraction) {
    if (progress_.is_none()) return;
    const py::gil_scoped_acquire gil;
    if (raised_) return;
    try {
      progress_(py::str(stage.data(), stage.size()), fraction);
    } catch (py::error_already_set& error) {
      raised_.emplace(std::move(error));
      job_.Cancel();
    }
  }

  const py::object progress_;
  std::optional<py::error_already_set> raised_;  // guarded by the GIL
  JobContext job_;
};

// See _core.pyi for what Python calls.
py::tuple Run(const std::string& request, const py::object& mesh, std::optional<double> timeout,
              const py::object& progress, bool on_device, const py::object& positions) {
  const ParsedConfig config = Parsed(request);
  Sources sources;
  sources.Add(mesh, config.mesh_type, positions);
  PythonJob job(timeout, progress);
  absl::StatusOr<Outcome> outcome = absl::UnknownError("the job did not run");
  job.Run([&] { outcome = RunOne(config, sources.list()[0], job.job(), on_device); });
  if (!outcome.ok()) Throw(outcome.status());
  return Answer(*std::move(outcome), config.request);
}

// Jobs that run at the same time, without progress.
struct Jobs {
  void Add(std::optional<double> timeout) {
    each.push_back(&all.emplace_back());
    SetTimeout(all.back(), timeout);
  }
  void Run(const std::function<void()>& work) {
    const auto cancel = [this] {
      for (JobContext& job : all) job.Cancel();
    };
    RunInterruptible(cancel, work);
  }
  std::deque<JobContext> all;
  std::vector<JobContext*> each;
};

py::bytes ErrorOf(const absl::Status& status) {
  return ToGrpcStatus(status).error_details();
}

py::list RunAll(const std::string& request, const py::list& meshes, std::optional<double> timeout) {
  const ParsedConfig config = Parsed(request);
  Sources sources;
  Jobs jobs;
  for (const py::handle item : meshes) {
    const auto [mesh, format, unit] = py::cast<std::tuple<py::object, int, int>>(item);
    sources.Add(mesh, TypeOf(format, unit), py::none());
    jobs.Add(timeout);
  }
  std::vector<absl::StatusOr<Outcome>> outcomes;
  jobs.Run([&] { outcomes = RunMany(config, sources.list(), jobs.each); });
  py::list answers;
  for (absl::StatusOr<Outcome>& outcome : outcomes) {
    if (outcome.ok()) {
      answers.append(Answer(*std::move(outcome), config.request));
    } else {
      answers.append(ErrorOf(outcome.status()));
    }
  }
  return answers;
}

py::list LoadEach(const py::list& meshes, std::optional<double> timeout) {
  std::deque<Buffer> buffers;
  std::vector<NamedFile> files;
  Jobs jobs;
  for (const py::handle item : meshes) {
    const auto [mesh, format, unit, name] = py::cast<std::tuple<py::object, int, int, std::string>>(item);
    files.push_back({buffers.emplace_back(mesh).bytes(), TypeOf(format, unit), name});
    jobs.Add(timeout);
  }
  std::vector<absl::StatusOr<std::shared_ptr<HeldMesh>>> loaded;
  jobs.Run([&] { loaded = LoadAll(files, jobs.each); });
  py::list answers;
  for (const absl::StatusOr<std::shared_ptr<HeldMesh>>& mesh : loaded) {
    if (mesh.ok()) {
      answers.append(*mesh);
    } else {
      answers.append(ErrorOf(mesh.status()));
    }
  }
  return answers;
}

py::bytes Estimate(const std::string& request, const py::object& mesh, std::optional<double> timeout) {
  const ParsedConfig config = Parsed(request);
  Sources sources;
  sources.Add(mesh, config.mesh_type, py::none());
  PythonJob job(timeout, py::none());
  absl::StatusOr<v1::EstimateVoxelizationResponse> response = absl::UnknownError("the job did not run");
  job.Run([&] { response = EstimateOne(config, sources.list()[0], job.job()); });
  if (!response.ok()) Throw(response.status());
  return response->SerializeAsString();
}

std::shared_ptr<HeldMesh> Load(const py::object& mesh, int format, int unit, const std::string& name,
                               std::optional<double> timeout, const py::object& progress) {
  const MeshFileType type = TypeOf(format, unit);
  const Buffer file(mesh);
  PythonJob job(timeout, progress);
  absl::StatusOr<std::shared_ptr<HeldMesh>> held = absl::UnknownError("the job did not run");
  job.Run([&] {
    try {
      held = HeldMesh::Load(file.bytes(), type, name, job.job());
    } catch (const std::bad_alloc&) {
      held = absl::ResourceExhaustedError("out of memory for the mesh");
    }
  });
  if (!held.ok()) Throw(held.status());
  return *std::move(held);
}

// By the names of `voxelpipe info --json`.
py::dict Health(const HeldMesh& mesh, std::optional<double> timeout) {
  PythonJob job(timeout, py::none());
  absl::StatusOr<MeshHealth> checked = absl::UnknownError("the job did not run");
  job.Run([&] {
    try {
      checked = mesh.Health(job.job());
    } catch (const std::bad_alloc&) {
      checked = absl::ResourceExhaustedError("out of memory for the health of the mesh");
    }
  });
  if (!checked.ok()) Throw(checked.status());
  py::dict facts;
  ForEachHealthFact(*checked, [&facts](const char* name, const auto& value) { facts[name] = value; });
  return facts;
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
  py::class_<voxelpipe::HeldMesh, std::shared_ptr<voxelpipe::HeldMesh>>(module, "HeldMesh")
      .def("describe", [](const voxelpipe::HeldMesh& m) { return py::bytes(m.Describe().SerializeAsString()); })
      .def("health", &voxelpipe::Health, py::arg("timeout"));
  module.def("load", &voxelpipe::Load, py::arg("mesh"), py::arg("format"), py::arg("unit"), py::arg("name"),
             py::arg("timeout"), py::arg("progress"));
  module.def("load_all", &voxelpipe::LoadEach, py::arg("meshes"), py::arg("timeout"));
  module.def("run", &voxelpipe::Run, py::arg("request"), py::arg("mesh"), py::arg("timeout"), py::arg("progress"),
             py::arg("on_device") = false, py::arg("positions") = py::none());
  module.def("run_all", &voxelpipe::RunAll, py::arg("request"), py::arg("meshes"), py::arg("timeout"));
  module.def("estimate", &voxelpipe::Estimate, py::arg("request"), py::arg("mesh"), py::arg("timeout"));
  module.def("shaders", &voxelpipe::Shaders);
  module.def("formats", &voxelpipe::Formats);
  module.def("not_kept", &voxelpipe::NotKept, py::arg("request"), py::arg("header"), py::arg("path"));
  module.def("write", &voxelpipe::WriteFile, py::arg("request"), py::arg("header"), py::arg("arrays"), py::arg("path"));
}

#include "load/gltf/geometry/gltf_accessor.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <string>
#include <type_traits>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "base/checked.h"
#include "base/huge_pages.h"
#include "base/vec.h"

namespace voxelpipe::gltf {
namespace {

constexpr uint64_t kStep = 1 << 20;  // elements copied between two polls of the job

// A checked run of elements: the last one ends inside `bytes`.
struct Run {
  std::span<const uint8_t> bytes;
  uint64_t offset = 0, stride = 0;
};

// Bytes of one element. Columns of a matrix are padded to 4 bytes.
uint64_t ColumnBytes(const AccessorDecl& decl) {
  const uint64_t component = ComponentBytes(decl.component_type);
  if (!decl.matrix) return component * decl.components;
  const uint64_t rows = decl.components == 4 ? 2 : (decl.components == 9 ? 3 : 4);
  return (component * rows + 3) / 4 * 4;
}

uint64_t ElementBytes(const AccessorDecl& decl) {
  if (!decl.matrix) return ColumnBytes(decl);
  const uint64_t columns = decl.components == 4 ? 2 : (decl.components == 9 ? 3 : 4);
  return ColumnBytes(decl) * columns;
}

// Proves that `count` elements fit.
absl::StatusOr<Run> CheckRun(std::span<const uint8_t> bytes, uint64_t offset, uint64_t stride, uint64_t element,
                             uint64_t count, const std::string& where, uint32_t view) {
  Run run{bytes, offset, stride == 0 ? element : stride};
  if (count == 0) return run;
  const std::optional<uint64_t> last = CheckedMul(count - 1, run.stride);
  const std::optional<uint64_t> size = last ? CheckedAdd(*last, element) : std::nullopt;
  const std::optional<uint64_t> end = size ? CheckedAdd(*size, offset) : std::nullopt;
  if (!end || *end > bytes.size()) {
    return absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ": ", count, " elements of ", element,
                                                   " bytes at byteOffset ", offset, " with stride ", run.stride,
                                                   " exceed bufferView ", view, " of ", bytes.size(), " bytes"));
  }
  return run;
}

template <typename C>
C Load(const uint8_t* at) {
  C value;
  std::memcpy(&value, at, sizeof value);
  return value;
}

template <typename T, typename C>
T Convert(C value, bool normalized) {
  if constexpr (std::is_same_v<T, float>) {
    if constexpr (std::is_floating_point_v<C>) return static_cast<float>(value);
    if (!normalized) return static_cast<float>(value);
    // glTF 2.0, section 3.6.2.2: f = max(c / max, -1) for signed types.
    const float scaled =
        static_cast<float>(static_cast<double>(value) / static_cast<double>(std::numeric_limits<C>::max()));
    return scaled < -1.0f ? -1.0f : scaled;
  } else {
    return static_cast<T>(value);
  }
}

template <typename T, typename C>
void CopyElement(const uint8_t* from, const AccessorDecl& decl, uint64_t column_bytes, T* to) {
  if (!decl.matrix) {
    for (int c = 0; c < decl.components; ++c) to[c] = Convert<T>(Load<C>(from + c * sizeof(C)), decl.normalized);
    return;
  }
  const int rows = decl.components == 4 ? 2 : (decl.components == 9 ? 3 : 4);
  for (int c = 0; c < decl.components; ++c) {
    to[c] = Convert<T>(Load<C>(from + (c / rows) * column_bytes + (c % rows) * sizeof(C)), decl.normalized);
  }
}

template <typename T, typename C>
void CopyRun(const Run& run, const AccessorDecl& decl, uint64_t begin, uint64_t end, T* out,
             const std::vector<uint32_t>* places) {
  const uint64_t column_bytes = ColumnBytes(decl);
  if (std::is_same_v<T, C> && places == nullptr && !decl.matrix && run.stride == column_bytes && begin < end) {
    std::memcpy(out + begin * decl.components, run.bytes.data() + run.offset + begin * column_bytes,
                (end - begin) * column_bytes);
    return;
  }
  for (uint64_t i = begin; i < end; ++i) {
    const uint64_t place = places == nullptr ? i : (*places)[i];
    CopyElement<T, C>(run.bytes.data() + run.offset + i * run.stride, decl, column_bytes,
                      out + place * decl.components);
  }
}

// Copies element i of the run to element places[i] of `out`, or to i without places. The job's error once it ended.
template <typename T>
absl::Status CopyTyped(const JobContext& job, const Run& run, const AccessorDecl& decl, uint64_t count, T* out,
                       const std::vector<uint32_t>* places) {
  for (uint64_t begin = 0; begin < count; begin += kStep) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    const uint64_t end = std::min(count, begin + kStep);
    switch (decl.component_type) {
      case 5120: CopyRun<T, int8_t>(run, decl, begin, end, out, places); break;
      case 5121: CopyRun<T, uint8_t>(run, decl, begin, end, out, places); break;
      case 5122: CopyRun<T, int16_t>(run, decl, begin, end, out, places); break;
      case 5123: CopyRun<T, uint16_t>(run, decl, begin, end, out, places); break;
      case 5125: CopyRun<T, uint32_t>(run, decl, begin, end, out, places); break;
      case kDoubleComponents: CopyRun<T, double>(run, decl, begin, end, out, places); break;
      default: CopyRun<T, float>(run, decl, begin, end, out, places); break;
    }
  }
  return absl::OkStatus();
}

// The elements of a run in the file, if they have the layout of E; null if they must be converted or gathered.
template <typename T, typename E>
const E* InPlace(const Run& run, const AccessorDecl& decl) {
  constexpr int kType = std::is_same_v<T, float> ? 5126 : (std::is_same_v<T, double> ? kDoubleComponents : 5125);
  if (decl.component_type != kType || decl.matrix || run.stride != ColumnBytes(decl)) return nullptr;
  const uint8_t* const first = run.bytes.data() + run.offset;
  return reinterpret_cast<uintptr_t>(first) % alignof(E) == 0 ? reinterpret_cast<const E*>(first) : nullptr;
}

bool IsUnsignedType(int type) {
  return type == 5121 || type == 5123 || type == 5125;
}

}  // namespace

template <typename T, typename E>
absl::StatusOr<std::vector<E>> AccessorReader::Read(uint32_t accessor) const {
  static_assert(std::is_trivially_copyable_v<E> && sizeof(E) % sizeof(T) == 0);
  const AccessorDecl& decl = document_.accessors[accessor];
  const std::string where = absl::StrCat("accessor ", accessor);
  const uint64_t element = ElementBytes(decl);

  // The range is checked first: a huge count over a small view is a fault of the accessor, not of the limits.
  Run run;
  if (decl.view >= 0) {
    const uint32_t view = static_cast<uint32_t>(decl.view);
    absl::StatusOr<std::span<const uint8_t>> bytes = buffers_.View(view, budget_);
    if (!bytes.ok()) return bytes.status();
    absl::StatusOr<Run> checked =
        CheckRun(*bytes, decl.offset, buffers_.Stride(view), element, decl.count, where, view);
    if (!checked.ok()) return checked.status();
    run = *checked;
  }
  if (decl.view < 0) {
    if (absl::Status many = budget_.CheckDeclared(decl.count, decl.components * sizeof(T), where); !many.ok())
      return many;
  }
  if (absl::Status full = budget_.Take(decl.count, decl.components * sizeof(T), where); !full.ok()) return full;
  const uint64_t size =
      decl.count * decl.components / (sizeof(E) / sizeof(T));  // NOLINT(bugprone-sizeof-expression): E holds several T
  const E* const plain = decl.view >= 0 && decl.count > 0 ? InPlace<T, E>(run, decl) : nullptr;
  std::vector<E> out;
  ReserveHuge(out, size);
  // In steps, because writing fresh pages takes long.
  for (uint64_t begin = 0; begin < size; begin += kStep) {
    if (absl::Status over = budget_.job().Check(); !over.ok()) return over;
    const uint64_t end = std::min(size, begin + kStep);
    if (plain != nullptr) {
      out.insert(out.end(), plain + begin, plain + end);
    } else {
      out.resize(end);
    }
  }
  T* const components = reinterpret_cast<T*>(out.data());
  if (plain == nullptr && decl.view >= 0) {
    if (absl::Status over = CopyTyped<T>(budget_.job(), run, decl, decl.count, components, nullptr); !over.ok())
      return over;
  }
  if (!decl.sparse) return out;

  const SparseDecl& sparse = *decl.sparse;
  if (!IsUnsignedType(sparse.index_type)) {
    return absl::InvalidArgumentError(
        absl::StrCat("glTF: ", where, ", sparse indices: component type ", sparse.index_type, " is not unsigned"));
  }
  absl::StatusOr<std::span<const uint8_t>> index_bytes = buffers_.View(sparse.index_view, budget_);
  if (!index_bytes.ok()) return index_bytes.status();
  absl::StatusOr<std::span<const uint8_t>> value_bytes = buffers_.View(sparse.value_view, budget_);
  if (!value_bytes.ok()) return value_bytes.status();
  AccessorDecl index_decl;
  index_decl.component_type = sparse.index_type;
  index_decl.components = 1;
  absl::StatusOr<Run> index_run = CheckRun(*index_bytes, sparse.index_offset, 0, ElementBytes(index_decl), sparse.count,
                                           where + ", sparse indices", sparse.index_view);
  if (!index_run.ok()) return index_run.status();
  absl::StatusOr<Run> value_run = CheckRun(*value_bytes, sparse.value_offset, 0, element, sparse.count,
                                           where + ", sparse values", sparse.value_view);
  if (!value_run.ok()) return value_run.status();
  MemoryCharge places_charge = budget_.NewCharge();
  if (absl::Status full = budget_.Take(sparse.count, sizeof(uint32_t), where, places_charge); !full.ok()) return full;
  std::vector<uint32_t> places(sparse.count);
  if (absl::Status over =
          CopyTyped<uint32_t>(budget_.job(), *index_run, index_decl, sparse.count, places.data(), nullptr);
      !over.ok()) {
    return over;
  }
  for (size_t i = 0; i < places.size(); ++i) {
    if (places[i] >= decl.count) {
      return absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ", sparse indices: entry ", i, " is ", places[i],
                                                     ", the accessor has ", decl.count, " elements"));
    }
  }
  if (absl::Status over = CopyTyped<T>(budget_.job(), *value_run, decl, sparse.count, components, &places);
      !over.ok()) {
    return over;
  }
  return out;
}

absl::StatusOr<std::vector<float>> AccessorReader::Floats(uint32_t accessor) const {
  return Read<float, float>(accessor);
}

template <typename V>
absl::StatusOr<std::vector<V>> AccessorReader::Vectors(uint32_t accessor) const {
  return Read<float, V>(accessor);
}
template absl::StatusOr<std::vector<Vec2f>> AccessorReader::Vectors(uint32_t) const;
template absl::StatusOr<std::vector<Vec3f>> AccessorReader::Vectors(uint32_t) const;
template absl::StatusOr<std::vector<Vec4f>> AccessorReader::Vectors(uint32_t) const;

absl::StatusOr<std::vector<Vec3d>> AccessorReader::Doubles(uint32_t accessor) const {
  return Read<double, Vec3d>(accessor);
}

absl::Status AccessorReader::CheckUnsigned(uint32_t accessor) const {
  if (IsUnsignedType(document_.accessors[accessor].component_type)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("glTF: accessor ", accessor, ": component type ",
                                                 document_.accessors[accessor].component_type,
                                                 " is not an unsigned integer"));
}

absl::StatusOr<std::vector<uint32_t>> AccessorReader::Unsigned(uint32_t accessor) const {
  if (absl::Status bad = CheckUnsigned(accessor); !bad.ok()) return bad;
  return Read<uint32_t, uint32_t>(accessor);
}

absl::StatusOr<std::vector<std::array<uint32_t, 3>>> AccessorReader::Triples(uint32_t accessor) const {
  if (absl::Status bad = CheckUnsigned(accessor); !bad.ok()) return bad;
  return Read<uint32_t, std::array<uint32_t, 3>>(accessor);
}

}  // namespace voxelpipe::gltf

#include "compare/comparison.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "compare/list_reader.h"
#include "compare/value_difference.h"

namespace voxelpipe::cli {
namespace {

constexpr uint64_t kBetweenChecks = 1 << 16;  // elements

bool SameComponents(const StoredResult& a, const StoredResult& b) {
  return std::equal(a.targets.begin(), a.targets.end(), b.targets.begin(), b.targets.end(),
                    [](const StoredTarget& x, const StoredTarget& y) { return x.components == y.components; });
}

bool SameTypes(const StoredResult& a, const StoredResult& b) {
  // A .npy has bits as bytes.
  const auto type = [](const StoredTarget& t) {
    return t.array.type == StoredType::kBit ? StoredType::kU8 : t.array.type;
  };
  return std::equal(a.targets.begin(), a.targets.end(), b.targets.begin(), b.targets.end(),
                    [&](const StoredTarget& x, const StoredTarget& y) { return type(x) == type(y); });
}

absl::Status CompareDense(const JobContext& job, const StoredResult& a, const StoredResult& b, double tolerance,
                          Comparison& out) {
  ValuePair pair(a, b, tolerance);
  ComparedOccupancy& occupancy = out.occupancy.emplace();
  for (uint64_t n = 0; n < a.voxels(); ++n) {
    absl::Status bad = n % kBetweenChecks == 0 ? job.Check() : absl::OkStatus();
    if (bad.ok()) bad = pair.NextA();
    if (bad.ok()) bad = pair.NextB();
    if (!bad.ok()) return bad;
    const bool in_a = pair.OccupiedA(), in_b = pair.OccupiedB();
    occupancy.a += in_a;
    occupancy.b += in_b;
    occupancy.only_a += in_a && !in_b;
    occupancy.only_b += in_b && !in_a;
    if (!out.values) continue;
    ++out.values->compared;
    const int target = pair.Difference(*out.values);
    if (target < 0) continue;
    ++out.values->differing;
    if (out.first) continue;
    const int64_t row = int64_t(n) / a.dims[0];
    out.first = {
        {int64_t(n) % a.dims[0], row % a.dims[1], row / a.dims[1]}, target, pair.a(target), pair.b(target), ""};
  }
  return absl::OkStatus();
}

// Compares the listed elements of two results, which are merged by their voxels.
class ListComparison {
 public:
  ListComparison(const StoredResult& a, const StoredResult& b, double tolerance, Comparison& out)
      : pair_(a, b, tolerance), list_a_(a), list_b_(b), out_(out) {}

  absl::Status Run(const JobContext& job) {
    absl::Status bad = list_a_.Next();
    if (bad.ok()) bad = list_b_.Next();
    ComparedOccupancy& occupancy = out_.occupancy.emplace();
    for (uint64_t n = 0; bad.ok() && !(list_a_.ended() && list_b_.ended()); ++n) {
      if (bad = n % kBetweenChecks == 0 ? job.Check() : absl::OkStatus(); !bad.ok()) break;
      const bool in_a = list_a_.key() <= list_b_.key(), in_b = list_b_.key() <= list_a_.key();
      occupancy.a += in_a;
      occupancy.b += in_b;
      occupancy.only_a += !in_b;
      occupancy.only_b += !in_a;
      bad = in_a && in_b ? Both() : in_a ? Alone(list_a_, true) : Alone(list_b_, false);
      if (bad.ok() && in_a) bad = list_a_.Next();
      if (bad.ok() && in_b) bad = list_b_.Next();
    }
    return bad;
  }

 private:
  void SetFirst(int target, bool in_a, bool in_b, std::string note) {
    if (out_.first) return;
    out_.first = {in_a ? list_a_.ijk() : list_b_.ijk(), target, {}, {}, std::move(note)};
    if (in_a) out_.first->a = pair_.a(target);
    if (in_b) out_.first->b = pair_.b(target);
  }

  // A voxel of one result only.
  absl::Status Alone(const ListReader& list, bool in_a) {
    uint64_t left = list.fragments();
    if (!out_.first) {
      if (absl::Status bad = in_a ? pair_.NextA() : pair_.NextB(); !bad.ok()) return bad;
      SetFirst(0, in_a, !in_a, "");
      --left;
    }
    in_a ? pair_.SkipA(left) : pair_.SkipB(left);
    return absl::OkStatus();
  }

  absl::Status Both() {
    const uint64_t n = list_a_.fragments(), m = list_b_.fragments();
    bool differs = n != m;
    std::string note = differs ? absl::StrCat(n, " fragments in A, ", m, " in B") : "";
    for (uint64_t i = 0; i < std::min(n, m); ++i) {
      absl::Status bad = pair_.NextA();
      if (bad.ok()) bad = pair_.NextB();
      int64_t triangle_a = 0, triangle_b = 0;
      if (bad.ok()) bad = list_a_.NextTriangle(triangle_a);
      if (bad.ok()) bad = list_b_.NextTriangle(triangle_b);
      if (!bad.ok()) return bad;
      if (triangle_a != triangle_b) {
        if (note.empty()) note = absl::StrCat("triangle ", triangle_a, " in A, ", triangle_b, " in B");
        SetFirst(0, true, true, note);
        differs = true;
      } else if (out_.values) {
        const int target = pair_.Difference(*out_.values);
        if (target >= 0) SetFirst(target, true, true, note);
        differs |= target >= 0;
      }
    }
    if (differs) SetFirst(0, true, true, note);  // the fragments in both are equal
    if (out_.values) {
      ++out_.values->compared;
      out_.values->differing += differs;
    }
    pair_.SkipA(n - std::min(n, m));
    pair_.SkipB(m - std::min(n, m));
    return absl::OkStatus();
  }

  ValuePair pair_;
  ListReader list_a_, list_b_;
  Comparison& out_;
};

}  // namespace

double ComparedOccupancy::iou() const {
  const uint64_t either = a + only_b;
  return either == 0 ? 1.0 : double(a - only_a) / double(either);
}

bool Comparison::equal() const {
  return same_dims && same_place.value_or(true) && same_targets && occupancy && occupancy->only_a == 0 &&
         occupancy->only_b == 0 && values && values->differing == 0;
}

absl::StatusOr<Comparison> Compare(const JobContext& job, const StoredResult& a, const StoredResult& b,
                                   double tolerance) {
  if (a.kind != b.kind) {
    return absl::InvalidArgumentError(absl::StrCat(a.path, " is ", std::string(Name(a.kind)), ", ", b.path, " is ",
                                                   std::string(Name(b.kind)), "; make both with the same --result"));
  }
  Comparison out;
  out.same_dims = a.dims == b.dims;
  if (a.place && b.place) out.same_place = *a.place == *b.place;
  const bool comparable = SameComponents(a, b);
  out.same_targets = comparable && SameTypes(a, b);
  if (!out.same_dims) return out;
  if (comparable) out.values.emplace();
  const absl::Status bad = a.kind == ResultKind::kDense ? CompareDense(job, a, b, tolerance, out)
                                                        : ListComparison(a, b, tolerance, out).Run(job);
  if (!bad.ok()) return bad;
  return out;
}

}  // namespace voxelpipe::cli

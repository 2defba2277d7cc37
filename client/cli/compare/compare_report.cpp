#include "compare/compare_report.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "engine/report.h"

namespace voxelpipe::cli {
namespace {

using nlohmann::ordered_json;

std::string TypeOf(const StoredTarget& target) {
  const std::string name(Name(target.array.type));
  return target.components == 1 ? name : absl::StrCat(name, "x", target.components);
}

ordered_json Describe(const StoredResult& result) {
  ordered_json json;
  json["file"] = result.path;
  json["dims"] = result.dims;
  json["origin"] = nullptr;
  json["voxel_size"] = nullptr;
  if (result.place) {
    const Vec3d &o = result.place->origin, &h = result.place->voxel_size;
    json["origin"] = {o.x, o.y, o.z};
    json["voxel_size"] = {h.x, h.y, h.z};
  }
  json["targets"] = ordered_json::array();
  for (const StoredTarget& target : result.targets) json["targets"].push_back(TypeOf(target));
  return json;
}

std::string DimsText(const StoredResult& result) {
  return absl::StrCat(result.dims[0], " x ", result.dims[1], " x ", result.dims[2]);
}

// With all digits where two of them differ.
std::string PlaceText(const StoredResult& result, bool all_digits) {
  const Vec3d &o = result.place->origin, &h = result.place->voxel_size;
  return all_digits
             ? absl::StrFormat("origin %.17g %.17g %.17g, voxels of %.17g x %.17g x %.17g", o.x, o.y, o.z, h.x, h.y,
                               h.z)
             : absl::StrFormat("origin %.6g %.6g %.6g, voxels of %.6g x %.6g x %.6g", o.x, o.y, o.z, h.x, h.y, h.z);
}

std::string TargetsText(const StoredResult& result) {
  std::string text;
  for (const StoredTarget& target : result.targets) absl::StrAppend(&text, text.empty() ? "" : " ", TypeOf(target));
  return text;
}

std::string ValuesText(const std::vector<double>& values) {
  if (values.empty()) return "not listed";
  std::string text;
  for (const double value : values) absl::StrAppend(&text, text.empty() ? "" : "/", absl::StrFormat("%.9g", value));
  return text;
}

}  // namespace

ordered_json ComparisonJson(const StoredResult& a, const StoredResult& b, double tolerance,
                            const Comparison& comparison) {
  ordered_json json;
  json["equal"] = comparison.equal();
  json["kind"] = std::string(Name(a.kind));
  json["tolerance"] = tolerance;
  json["a"] = Describe(a);
  json["b"] = Describe(b);
  json["same_dims"] = comparison.same_dims;
  json["same_place"] = comparison.same_place ? ordered_json(*comparison.same_place) : ordered_json(nullptr);
  json["same_targets"] = comparison.same_targets;
  json["occupancy"] = nullptr;
  if (const auto& o = comparison.occupancy) {
    json["occupancy"] = {{"a", o->a}, {"b", o->b}, {"only_a", o->only_a}, {"only_b", o->only_b}, {"iou", o->iou()}};
  }
  json["values"] = nullptr;
  if (const auto& v = comparison.values) {
    json["values"] = {{"compared", v->compared}, {"differing", v->differing}, {"largest_difference", v->largest}};
  }
  json["first"] = nullptr;
  if (const auto& f = comparison.first) {
    json["first"] = {{"ijk", f->ijk}, {"target", f->target}, {"a", f->a}, {"b", f->b}};
    if (f->a.empty()) json["first"]["a"] = nullptr;
    if (f->b.empty()) json["first"]["b"] = nullptr;
    if (!f->note.empty()) json["first"]["note"] = f->note;
  }
  return json;
}

Lines ComparisonTable(const StoredResult& a, const StoredResult& b, double tolerance, const Comparison& comparison) {
  Lines table = {absl::StrCat("A = ", a.path), absl::StrCat("B = ", b.path)};
  const auto row = [&](const char* name, const std::string& text) { table.push_back(TableRow(name, text)); };
  const auto both = [&](bool same, const std::string& in_a, const std::string& in_b) {
    return same ? absl::StrCat("same: ", in_a) : absl::StrCat("differ: A ", in_a, "; B ", in_b);
  };
  row("result", comparison.equal() ? "equal" : "different");
  row("kind", std::string(Name(a.kind)));
  row("dims", both(comparison.same_dims, DimsText(a), DimsText(b)));
  if (const std::optional<bool> same = comparison.same_place) {
    row("place", both(*same, PlaceText(a, !*same), PlaceText(b, !*same)));
  } else {
    row("place", "not compared: a .npy has none");
  }
  row("targets", both(comparison.same_targets, TargetsText(a), TargetsText(b)));
  if (const auto& o = comparison.occupancy) {
    row("occupied", absl::StrCat("A ", WithCommas(o->a), ", B ", WithCommas(o->b), ", only A ", WithCommas(o->only_a),
                                 ", only B ", WithCommas(o->only_b), absl::StrFormat(", IoU %.6f", o->iou())));
  }
  if (const auto& v = comparison.values) {
    row("values", absl::StrCat(WithCommas(v->differing), " of ", WithCommas(v->compared), " voxels differ",
                               tolerance > 0 ? absl::StrFormat(" by more than %.9g", tolerance) : "",
                               absl::StrFormat(", largest difference %.9g", v->largest)));
  } else {
    row("values", comparison.same_dims ? "not compared: the targets differ" : "not compared: the dims differ");
  }
  if (const auto& f = comparison.first) {
    row("first", absl::StrCat("voxel (", f->ijk[0], ", ", f->ijk[1], ", ", f->ijk[2], "), target ", f->target, ": A ",
                              ValuesText(f->a), ", B ", ValuesText(f->b), f->note.empty() ? "" : ", ", f->note));
  }
  return table;
}

}  // namespace voxelpipe::cli

#include "request_text/axes.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "shaders/catalog.h"

namespace voxelpipe {
namespace {

absl::Status NoAxes(std::string_view text) {
  return absl::InvalidArgumentError(
      absl::StrCat("'", std::string(text), "' is not x, y and z, each once and perhaps negative, as in x,z,-y"));
}

Mat4d MatrixOf(const std::vector<double>& numbers) {
  Mat4d matrix;
  for (size_t i = 0; i < 16; ++i) matrix.m[i / 4][i % 4] = numbers[i];
  return matrix;
}

// 16 numbers, row major. 0 is added so that none is -0.
std::vector<double> NumbersOf(const Mat4d& matrix) {
  std::vector<double> numbers;
  for (size_t i = 0; i < 16; ++i) numbers.push_back(matrix.m[i / 4][i % 4] + 0.0);
  return numbers;
}

}  // namespace

absl::StatusOr<Mat4d> ParseAxes(std::string_view text) {
  Mat4d matrix;
  for (auto& row : matrix.m) {
    for (double& number : row) number = 0;
  }
  matrix.m[3][3] = 1;
  bool used[3] = {};
  std::string_view rest = text;
  for (int axis = 0; axis < 3; ++axis) {
    double sign = 1;
    if (!rest.empty() && (rest.front() == '-' || rest.front() == '+')) {
      sign = rest.front() == '-' ? -1 : 1;
      rest.remove_prefix(1);
    }
    const size_t from = rest.empty() ? std::string_view::npos : std::string_view("xyz").find(rest.front());
    if (from == std::string_view::npos || used[from]) return NoAxes(text);
    used[from] = true;
    matrix.m[axis][from] = sign;
    rest.remove_prefix(1);
    const bool ends = axis == 2 ? rest.empty() : !rest.empty() && rest.front() == ',';
    if (!ends) return NoAxes(text);
    if (axis < 2) rest.remove_prefix(1);
  }
  return matrix;
}

absl::StatusOr<ShaderCall> WithAxes(const ShaderCall& call, const Mat4d& axes) {
  if (axes == Mat4d()) return call;
  if (call.name != "identity" && call.name != "transform") {
    return absl::InvalidArgumentError(
        absl::StrCat("turns the mesh by the vertex shader transform; '", call.name,
                     "' cannot be turned: leave the axes out, or turn the mesh in its file"));
  }
  // Wrong parameters are reported as they were given.
  if (const auto bound = BindShader(ShaderStage::kVertex, call); !bound.ok()) return bound.status();
  ShaderCall turned = call;
  turned.name = "transform";
  for (const char* name : {"matrix", "matrix_previous"}) {
    const auto given = call.parameters.find(name);
    const Mat4d matrix = given == call.parameters.end() ? Mat4d() : MatrixOf(given->second);
    turned.parameters[name] = NumbersOf(Multiply(axes, matrix));
  }
  // An angular velocity is a pseudovector: a mirror turns it the other way.
  const double handedness = Determinant3(axes);
  const std::pair<const char*, double> motion[] = {
      {"linear_velocity", 1}, {"center", 1}, {"angular_velocity", handedness}};
  for (const auto& [name, factor] : motion) {
    const auto given = turned.parameters.find(name);
    if (given == turned.parameters.end()) continue;
    std::vector<double>& v = given->second;
    const Vec3d at = TransformPoint(axes, Vec3d{v[0], v[1], v[2]});
    v = {factor * at.x + 0.0, factor * at.y + 0.0, factor * at.z + 0.0};
  }
  return turned;
}

}  // namespace voxelpipe

// Plain vector and matrix types shared by host and device code. No SIMD, no operators that hide a rounding:
// every expression rounds once per written operation (the project is compiled without contraction).
#pragma once

#include "base/host_device.h"

namespace voxelpipe {

template <typename T>
struct Vec2 {
  T x{}, y{};
  friend bool operator==(const Vec2&, const Vec2&) = default;
};

template <typename T>
struct Vec3 {
  T x{}, y{}, z{};

  // Component by axis: 0 = x, 1 = y, 2 = z.
  VOXELPIPE_HD T& operator[](int axis) { return axis == 0 ? x : (axis == 1 ? y : z); }
  VOXELPIPE_HD const T& operator[](int axis) const { return axis == 0 ? x : (axis == 1 ? y : z); }
  friend bool operator==(const Vec3&, const Vec3&) = default;
};

template <typename T>
struct Vec4 {
  T x{}, y{}, z{}, w{};

  VOXELPIPE_HD T& operator[](int i) { return i == 0 ? x : (i == 1 ? y : (i == 2 ? z : w)); }
  VOXELPIPE_HD const T& operator[](int i) const { return i == 0 ? x : (i == 1 ? y : (i == 2 ? z : w)); }
  friend bool operator==(const Vec4&, const Vec4&) = default;
};

using Vec2f = Vec2<float>;
using Vec3f = Vec3<float>;
using Vec4f = Vec4<float>;
using Vec3d = Vec3<double>;
using Vec3i = Vec3<int>;

template <typename T>
VOXELPIPE_HD Vec3<T> operator+(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <typename T>
VOXELPIPE_HD Vec3<T> operator-(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <typename T>
VOXELPIPE_HD Vec3<T> operator*(const Vec3<T>& a, T s) {
  return {a.x * s, a.y * s, a.z * s};
}
template <typename T>
VOXELPIPE_HD T Dot(const Vec3<T>& a, const Vec3<T>& b) {
  return (a.x * b.x + a.y * b.y) + a.z * b.z;
}
template <typename T>
VOXELPIPE_HD Vec3<T> Cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// Our own min and max: the library's differ between host and device in how they treat NaN and -0.
template <typename T>
VOXELPIPE_HD T Min(T a, T b) {
  return b < a ? b : a;
}
template <typename T>
VOXELPIPE_HD T Max(T a, T b) {
  return a < b ? b : a;
}
template <typename T>
VOXELPIPE_HD T Abs(T a) {
  return a < T(0) ? -a : a;
}
template <typename T>
VOXELPIPE_HD T Clamp(T v, T lo, T hi) {
  return v < lo ? lo : (hi < v ? hi : v);
}

// A 4x4 matrix in row-major order: m[row][column]; it transforms column vectors, p' = M p.
struct Mat4d {
  double m[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
  friend bool operator==(const Mat4d&, const Mat4d&) = default;
};

VOXELPIPE_HD Vec3d TransformPoint(const Mat4d& a, const Vec3d& p) {
  return {((a.m[0][0] * p.x + a.m[0][1] * p.y) + a.m[0][2] * p.z) + a.m[0][3],
          ((a.m[1][0] * p.x + a.m[1][1] * p.y) + a.m[1][2] * p.z) + a.m[1][3],
          ((a.m[2][0] * p.x + a.m[2][1] * p.y) + a.m[2][2] * p.z) + a.m[2][3]};
}

// The linear part only (directions).
VOXELPIPE_HD Vec3d TransformVector(const Mat4d& a, const Vec3d& v) {
  return {(a.m[0][0] * v.x + a.m[0][1] * v.y) + a.m[0][2] * v.z, (a.m[1][0] * v.x + a.m[1][1] * v.y) + a.m[1][2] * v.z,
          (a.m[2][0] * v.x + a.m[2][1] * v.y) + a.m[2][2] * v.z};
}

// Normals transform with the cofactor matrix (the inverse transpose times the determinant), which also exists for
// singular matrices and keeps a normal on its side of a mirrored surface when multiplied by the determinant's sign.
VOXELPIPE_HD Vec3d TransformNormal(const Mat4d& a, const Vec3d& n) {
  const Vec3d c0{a.m[0][0], a.m[1][0], a.m[2][0]};
  const Vec3d c1{a.m[0][1], a.m[1][1], a.m[2][1]};
  const Vec3d c2{a.m[0][2], a.m[1][2], a.m[2][2]};
  const Vec3d r0 = Cross(c1, c2), r1 = Cross(c2, c0), r2 = Cross(c0, c1);
  const double sign = Dot(c0, r0) < 0 ? -1.0 : 1.0;
  return {sign * ((r0.x * n.x + r1.x * n.y) + r2.x * n.z), sign * ((r0.y * n.x + r1.y * n.y) + r2.y * n.z),
          sign * ((r0.z * n.x + r1.z * n.y) + r2.z * n.z)};
}

VOXELPIPE_HD Mat4d Multiply(const Mat4d& a, const Mat4d& b) {
  Mat4d r;
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      r.m[i][j] = ((a.m[i][0] * b.m[0][j] + a.m[i][1] * b.m[1][j]) + a.m[i][2] * b.m[2][j]) + a.m[i][3] * b.m[3][j];
    }
  }
  return r;
}

// Determinant of the upper-left 3x3 part: negative where the matrix mirrors.
VOXELPIPE_HD double Determinant3(const Mat4d& a) {
  return (a.m[0][0] * (a.m[1][1] * a.m[2][2] - a.m[1][2] * a.m[2][1]) -
          a.m[0][1] * (a.m[1][0] * a.m[2][2] - a.m[1][2] * a.m[2][0])) +
         a.m[0][2] * (a.m[1][0] * a.m[2][1] - a.m[1][1] * a.m[2][0]);
}

}  // namespace voxelpipe

// The camera of the preview.
#pragma once

#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/vec.h"

namespace voxelpipe {

// Where the viewer is, seen from the voxels, in degrees. The picture is orthographic, +Y is up.
struct PreviewView {
  double azimuth = 45;                    // about +Y, from +Z (0) towards +X (90); -360 to 360
  double elevation = 35.264389682754654;  // above the plane of X and Z; -90 to 90. Default: atan(1/sqrt(2))
  friend bool operator==(const PreviewView&, const PreviewView&) = default;
};

// In: iso (the default view, where the three axes appear equally long), front (the viewer is at +Z), back (-Z), right
// (+X), left (-X), top (+Y; -Z is up), bottom (-Y; +Z is up), or "AZIMUTH,ELEVATION" in degrees. INVALID_ARGUMENT that
// quotes the text and lists these otherwise.
absl::StatusOr<PreviewView> ParseView(std::string_view text);

// INVALID_ARGUMENT for angles out of range or not finite.
absl::Status CheckView(const PreviewView& view);

// Unit vectors, world axes: to the right and upwards in the picture, and towards the viewer.
struct ViewFrame {
  Vec3d right, up, eye;
};
ViewFrame FrameOf(const PreviewView& view);

}  // namespace voxelpipe

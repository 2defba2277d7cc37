// A bound on the orientations in the texture coordinates of a Draco stream.
#pragma once

namespace voxelpipe {

// Does nothing itself: a program that calls it is linked with draco_orientations.cpp, whose functions then replace
// those of the Draco library.
void UseBoundedOrientations();

}  // namespace voxelpipe

// A bound on what a Draco stream may say of its texture coordinates.
#pragma once

namespace voxelpipe {

// Does nothing itself: a program that calls it is linked with draco_orientations.cpp, whose functions the Draco library
// then uses in place of its own.
void UseBoundedOrientations();

}  // namespace voxelpipe

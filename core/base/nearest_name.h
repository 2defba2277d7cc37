// What a mistyped name was meant to be.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace voxelpipe {

// The first of `known` with the fewest edits (a byte inserted, removed, replaced, or two neighbours swapped; case does
// not count) to `name`, or one as near that begins with it. Empty if that takes more than a third of the name's bytes
// (but 1 is allowed), or more than 3. Names beyond 100 bytes are near to none.
// To "gpu", "cuda" is nearest.
std::string NearestName(std::string_view name, const std::vector<std::string>& known);

// The same as "did you mean 'normal'?", or empty.
std::string DidYouMean(std::string_view name, const std::vector<std::string>& known);

// "unknown choice 'partiy'; did you mean 'parity'? known are none, parity, flood".
std::string UnknownChoice(std::string_view text, const std::vector<std::string>& known);

}  // namespace voxelpipe

#!/usr/bin/env python3
"""Prints core/shaders/texture/srgb_thresholds.h: the smallest linear float32 of each 8-bit sRGB code or more.

Code k begins where the transfer function of IEC 61966-2-1 reaches (k - 1/2) / 255. Everything is rational arithmetic: a float32 t
lies at or above the power law's ((c + 0.055) / 1.055) ** 2.4 where t ** 5 >= ((c + 0.055) / 1.055) ** 12.
"""
import struct
from fractions import Fraction


def float_of(bits):
    return struct.unpack("<f", struct.pack("<I", bits))[0]


def reaches(bits, code):
    """True if the float32 of these bits encodes to the code or a greater one."""
    linear = Fraction(float_of(bits))
    encoded = Fraction(2 * code - 1, 510)
    if encoded <= Fraction("0.04045"):
        return linear >= encoded / Fraction("12.92")
    return linear**5 >= ((encoded + Fraction("0.055")) / Fraction("1.055")) ** 12


def threshold(code):
    lo, hi = 0, 0x3F800000  # 0 and 1, whose bits are ordered as they are
    while hi - lo > 1:
        middle = (lo + hi) // 2
        lo, hi = (lo, middle) if reaches(middle, code) else (middle, hi)
    return hi


def literal(bits):
    mantissa, exponent = bits & 0x7FFFFF, (bits >> 23) - 127
    return f"0x1.{2 * mantissa:06x}p{exponent:+d}f"


print("""// The smallest linear float32 that encodes to each 8-bit sRGB code or a greater one.
// Printed by tests/support/make_srgb_thresholds.py.
#pragma once

#include "base/host_device.h"

namespace voxelpipe {

// Of code i + 1.
VOXELPIPE_HD float SrgbThreshold(int i) {
  static constexpr float kTable[255] = {""")
values = [literal(threshold(code)) for code in range(1, 256)]
for first in range(0, 255, 6):
    print("      " + " ".join(value + "," for value in values[first : first + 6]))
print("""  };
  return kTable[i];
}

}  // namespace voxelpipe""")

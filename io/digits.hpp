#pragma once

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <string>

namespace dimple {

// Numbers for people, in every text, picture and page: three significant digits and no exponent. Files for
// programs hold SI and mm with all digits.

/// A fixed number of digits after the point, with a point in every locale, and never a minus before zero.
inline std::string fixed(double x, int decimals) {
  if (!std::isfinite(x)) return std::isnan(x) ? "nan" : x > 0.0 ? "inf" : "-inf";
  std::array<char, 400> digits;
  const auto end =
      std::to_chars(digits.data(), digits.data() + digits.size(), x, std::chars_format::fixed, decimals);
  std::string text(digits.data(), end.ptr);
  return text.find_first_not_of("-0.") == std::string::npos && text.starts_with('-') ? text.substr(1) : text;
}

/// A change, with its sign and one decimal; "0.0" where it rounds to zero.
inline std::string with_sign(double x) {
  const std::string text = fixed(x, 1);
  return text.starts_with('-') || text == "0.0" || !std::isfinite(x) ? text : '+' + text;
}

/// Digits after the point that leave this many significant ones, after rounding to them.
inline int decimals_of(double x, int digits = 3) {
  if (!(std::abs(x) > 0.0) || !std::isfinite(x)) return 0;
  const int whole = static_cast<int>(std::floor(std::log10(std::abs(x))));
  const double rounded = std::abs(x) * std::pow(10.0, digits - 1 - whole) + 0.5;
  return std::clamp(digits - 1 - whole - (rounded >= std::pow(10.0, digits) ? 1 : 0), 0, 15);
}

/// Text with three significant digits: "8.00", "0.550", "1234".
inline std::string three_digits(double x) {
  return fixed(x, decimals_of(x));
}

/// A number that a user has given, as short as possible: "8", "0.0001", "1234567".
inline std::string plain(double x, int digits = 6) {
  std::string text = fixed(x, decimals_of(x, digits));
  if (text.find('.') == std::string::npos) return text;
  text.erase(text.find_last_not_of('0') + 1);
  if (text.ends_with('.')) text.pop_back();
  return text;
}

/// Format for numbers of one size, so that numbers next to each other have the same unit and digits.
struct Written {
  const char* unit;
  double per_unit;  ///< units in one of SI, or in one mm, mm3 or percent
  int decimals;

  /// Text of a number; a small one is never shown as zero: "< 0.01".
  std::string number(double x) const {
    const double shown = x * per_unit, least = std::pow(10.0, -decimals);
    if (shown != 0.0 && std::abs(shown) < least) return "< " + fixed(least, decimals);
    return fixed(shown, decimals);
  }
  std::string operator()(double x) const { return number(x) + ' ' + unit; }
};

/// Format for forces of this size [N] and those next to it: N from 0.1 N, mN from 0.1 mN on, else uN or nN.
inline Written force_written(double N) {
  const double size = std::abs(N);
  if (size == 0.0 || !std::isfinite(size)) return {"N", 1.0, 0};
  const auto in = [size](const char* unit, double per_unit) {
    return Written{unit, per_unit, std::min(decimals_of(per_unit * size), 3)};
  };
  constexpr double tenth = 0.09995;  // is 0.100 in three digits
  return size >= tenth          ? in("N", 1.0)
         : size >= tenth * 1e-3 ? in("mN", 1e3)
         : size >= tenth * 1e-6 ? in("uN", 1e6)
                                : in("nN", 1e9);
}

/// Format for volumes of this size [mm3]: cm3 from 1 cm3 on, else mm3.
inline Written volume_written(double mm3) {
  const double size = std::abs(mm3);
  if (size >= 999.5) return {"cm3", 1e-3, decimals_of(1e-3 * size)};
  return {"mm3", 1.0, std::min(decimals_of(size), 3)};
}

/// Format for percentages: "101 %", "3.41 %", "0.05 %", "< 0.01 %".
inline Written percent_written(double percent) {
  return {"%", 1.0, std::min(decimals_of(percent), 2)};
}

// Text of a single force.
inline std::string force_in_words(double N) {
  return force_written(N)(N);
}
inline std::string volume_in_words(double mm3) {
  return volume_written(mm3)(mm3);
}
/// Percentage of a fraction: 0.0341 is "3.41 %".
inline std::string percent(double fraction) {
  return percent_written(100.0 * fraction)(100.0 * fraction);
}
/// Format for lengths: "8.00 mm", "0.50 mm", "0.0123 mm".
inline Written length_written(double mm) {
  return {"mm", 1.0, mm == 0.0 || std::abs(mm) >= 0.1 ? 2 : decimals_of(mm)};
}
inline std::string length_in_words(double mm) {
  return length_written(mm)(mm);
}
/// Text of a stress: "210 Pa", "12.5 kPa", "200 MPa".
inline std::string stress_in_words(double Pa) {
  const double size = std::abs(Pa);
  return size >= 1e7   ? plain(1e-6 * Pa, 4) + " MPa"
         : size >= 1e4 ? plain(1e-3 * Pa, 4) + " kPa"
                       : plain(Pa, 4) + " Pa";
}

}  // namespace dimple

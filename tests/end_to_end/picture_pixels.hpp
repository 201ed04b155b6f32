#pragma once

#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPNGReader.h>

#include <filesystem>

namespace dimple {

/// Part of a picture: fractions of its width and height from the upper left.
struct Part {
  double left = 0.0, top = 0.0, right = 1.0, bottom = 1.0;
};

/// Fraction of the pixels in a picture's part for which `is`(red, green, blue), each from 0 to 255, holds.
template <class Is>
double fraction_of_pixels(const std::filesystem::path& png, const Is& is, const Part& part = {}) {
  vtkNew<vtkPNGReader> reader;
  reader->SetFileName(png.c_str());
  reader->Update();
  vtkImageData* image = reader->GetOutput();
  int size[3];
  image->GetDimensions(size);
  const auto at = [&](double fraction, int axis) { return static_cast<int>(fraction * size[axis]); };
  long count = 0, all = 0;
  for (int y = at(1.0 - part.bottom, 1); y < at(1.0 - part.top, 1); ++y)
    for (int x = at(part.left, 0); x < at(part.right, 0); ++x) {
      const auto* p = static_cast<const unsigned char*>(image->GetScalarPointer(x, y, 0));
      count += is(p[0], p[1], p[2]);
      ++all;
    }
  return static_cast<double>(count) / static_cast<double>(all);
}

/// Number of separate lines of grey letters above the first row with colours, on white.
inline int lines_above_colours(const std::filesystem::path& png) {
  vtkNew<vtkPNGReader> reader;
  reader->SetFileName(png.c_str());
  reader->Update();
  vtkImageData* image = reader->GetOutput();
  int size[3], lines = 0;
  image->GetDimensions(size);
  bool before = false;
  for (int y = size[1] - 1; y >= 0; --y) {
    int dark = 0, coloured = 0;
    for (int x = 0; x < size[0] / 2; ++x) {
      const auto* p = static_cast<const unsigned char*>(image->GetScalarPointer(x, y, 0));
      coloured += p[0] > p[2] + 60;
      dark += p[0] < 140;
    }
    if (coloured > 0) break;
    lines += dark > 0 && !before;
    before = dark > 0;
  }
  return lines;
}

inline bool is_white(int red, int green, int blue) {
  return red > 250 && green > 250 && blue > 250;
}

}  // namespace dimple

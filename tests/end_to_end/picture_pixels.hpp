#pragma once

#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPNGReader.h>

#include <filesystem>

namespace dimple {

/// The share of a picture's pixels for which `is`(red, green, blue), each from 0 to 255, holds.
template <class Is>
double share_of_pixels(const std::filesystem::path& png, const Is& is) {
  vtkNew<vtkPNGReader> reader;
  reader->SetFileName(png.c_str());
  reader->Update();
  vtkImageData* image = reader->GetOutput();
  int size[3];
  image->GetDimensions(size);
  long count = 0;
  for (int y = 0; y < size[1]; ++y)
    for (int x = 0; x < size[0]; ++x) {
      const auto* p = static_cast<const unsigned char*>(image->GetScalarPointer(x, y, 0));
      count += is(p[0], p[1], p[2]);
    }
  return static_cast<double>(count) / (static_cast<double>(size[0]) * size[1]);
}

inline bool is_white(int red, int green, int blue) {
  return red > 250 && green > 250 && blue > 250;
}

}  // namespace dimple

#include "io/draw/canvas.hpp"

#include <fmt/format.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPNGWriter.h>
#include <vtkUnsignedCharArray.h>

#include <cmath>

#include "io/error.hpp"

namespace dimple::draw {

namespace {

constexpr std::array<double, 2> dash{7.0, 6.0};  ///< drawn, left out [pixels]

/// Two decimals at most: far finer than a pixel, and short.
std::string number(double value) {
  std::string text = fmt::format("{:.2f}", value);
  while (text.back() == '0') text.pop_back();
  if (text.back() == '.') text.pop_back();
  return text == "-0" ? "0" : text;
}

std::string list(const std::vector<Vec2>& points) {
  std::string text;
  for (const Vec2& p : points)
    text += fmt::format("{}{},{}", text.empty() ? "" : " ", number(p.x()), number(p.y()));
  return text;
}

}  // namespace

std::string in_hex(const Colour& c) {
  const auto part = [](float value) { return std::lround(value * 255.0F); };
  return fmt::format("#{:02x}{:02x}{:02x}", part(c.red), part(c.green), part(c.blue));
}

Canvas::Canvas(int width, int height, Format format)
    : columns_(width * fine), rows_(height * fine), shown_{}, is_svg_(format == Format::svg) {
  clip();
  if (is_svg_)
    svg_ = fmt::format(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0}\" height=\"{1}\" "
        "viewBox=\"0 0 {0} {1}\" font-family=\"sans-serif\">\n"
        "<rect width=\"{0}\" height=\"{1}\" fill=\"{2}\"/>\n",
        width, height, in_hex(page));
  else
    pixel_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), pixel_of(page));
}

void Canvas::clip(const Rect& r) {
  shown_ = {pixel_within(r.x * fine, columns_), pixel_within((r.x + r.w) * fine, columns_) - 1,
            pixel_within(r.y * fine, rows_), pixel_within((r.y + r.h) * fine, rows_) - 1};
}

template <class Distance>
void Canvas::paint(const Rect& bounds, const Colour& colour, Distance distance) {
  const int x0 = std::max(pixel_within((bounds.x - 1.0) * fine, columns_), shown_[0]);
  const int x1 = std::min(pixel_within((bounds.x + bounds.w + 1.0) * fine, columns_), shown_[1]);
  const int y0 = std::max(pixel_within((bounds.y - 1.0) * fine, rows_), shown_[2]);
  const int y1 = std::min(pixel_within((bounds.y + bounds.h + 1.0) * fine, rows_), shown_[3]);
  for (int y = y0; y <= y1; ++y)
    for (int x = x0; x <= x1; ++x) {
      const double d = distance((x + 0.5) / fine, (y + 0.5) / fine);
      blend(x, y, colour, std::clamp(0.5 - d * fine, 0.0, 1.0));
    }
}

void Canvas::rectangle(const Rect& r, const Colour& colour, double corner) {
  if (is_svg_) {
    svg_ += fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"{} fill=\"{}\"/>\n", number(r.x),
                        number(r.y), number(r.w), number(r.h),
                        corner > 0.0 ? fmt::format(" rx=\"{}\"", number(corner)) : "", in_hex(colour));
    return;
  }
  const int x0 = pixel_within(r.x * fine, columns_), x1 = pixel_within((r.x + r.w) * fine, columns_);
  const int y0 = pixel_within(r.y * fine, rows_), y1 = pixel_within((r.y + r.h) * fine, rows_);
  const Pixel solid = pixel_of(colour);
  for (int y = y0; y < y1; ++y) {
    const double to_edge = (std::min(y - y0, y1 - 1 - y) + 0.5) / fine;
    const double short_of = std::max(corner - to_edge, 0.0);
    const double indent = corner - std::sqrt(corner * corner - short_of * short_of);
    const int inset = static_cast<int>(std::lround(indent * fine));
    for (int x = x0 + inset; x < x1 - inset; ++x) pixel_[index(x, y)] = solid;
  }
}

void Canvas::disc(const Vec2& centre, double radius, const Colour& colour) {
  if (is_svg_) {
    svg_ += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"{}\" fill=\"{}\"/>\n", number(centre.x()),
                        number(centre.y()), number(radius), in_hex(colour));
    return;
  }
  paint({centre.x() - radius, centre.y() - radius, 2.0 * radius, 2.0 * radius}, colour,
        [radius, cx = centre.x(), cy = centre.y()](double x, double y) {
          return std::sqrt((x - cx) * (x - cx) + (y - cy) * (y - cy)) - radius;
        });
}

void Canvas::segment(const Vec2& a, const Vec2& b, double thickness, const Colour& colour) {
  const Vec2 along = b - a;
  const double length2 = std::max(along.squaredNorm(), 1e-12), r = thickness / 2.0;
  const Vec2 low = a.cwiseMin(b).array() - r, high = a.cwiseMax(b).array() + r;
  paint({low.x(), low.y(), high.x() - low.x(), high.y() - low.y()}, colour,
        [=, ax = a.x(), ay = a.y(), ux = along.x(), uy = along.y()](double x, double y) {
          const double t = std::clamp(((x - ax) * ux + (y - ay) * uy) / length2, 0.0, 1.0);
          const double dx = x - ax - t * ux, dy = y - ay - t * uy;
          return std::sqrt(dx * dx + dy * dy) - r;
        });
}

void Canvas::curve(const std::vector<Vec2>& points, double thickness, const Colour& colour, bool dashed) {
  if (is_svg_) {
    svg_ += fmt::format(
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" "
        "stroke-linecap=\"round\" stroke-linejoin=\"round\"{}/>\n",
        list(points), in_hex(colour), number(thickness),
        dashed ? fmt::format(" stroke-dasharray=\"{} {}\"", number(dash[0]), number(dash[1])) : "");
    return;
  }
  std::size_t part = 0;
  double left = dash[0];  // of the current dash or gap
  for (std::size_t i = 1; i < points.size(); ++i) {
    const Vec2 a = points[i - 1], b = points[i];
    if (!dashed) {
      segment(a, b, thickness, colour);
      continue;
    }
    const double length = (b - a).norm();
    for (double from = 0.0; from < length;) {
      const double to = std::min(from + left, length);
      if (part == 0) segment(a + (b - a) * (from / length), a + (b - a) * (to / length), thickness, colour);
      left -= to - from;
      if (!(left > 1e-9)) part = 1 - part, left = dash[part];
      from = to;
    }
  }
}

void Canvas::polygon(const std::vector<Vec2>& corners, const Colour& colour) {
  if (is_svg_) {
    svg_ += fmt::format("<polygon points=\"{}\" fill=\"{}\"/>\n", list(corners), in_hex(colour));
    return;
  }
  Pieces outline;
  for (std::size_t i = 0; i < corners.size(); ++i)
    outline.push_back({corners[i], corners[(i + 1) % corners.size()]});
  area(outline, colour);
}

// By lines of a quarter of a pixel, on which coverage is exact.
void Canvas::area(const Pieces& outline, const Colour& colour) {
  double top = rows_, bottom = 0.0;
  for (const auto& piece : outline)
    for (const Vec2& end : piece)
      top = std::min(top, end.y() * fine), bottom = std::max(bottom, end.y() * fine);
  const int last = std::min(pixel_within(bottom, rows_), shown_[3]);
  std::vector<double> cover, at;
  for (int y = std::max(pixel_within(top, rows_), shown_[2]); y <= last; ++y) {
    cover.assign(static_cast<std::size_t>(columns_), 0.0);
    for (const double part : {0.125, 0.375, 0.625, 0.875}) {
      at.clear();
      for (const auto& [a, b] : outline) {
        const double above = y + part - a.y() * fine, below = y + part - b.y() * fine;
        if ((above < 0.0) == (below < 0.0) || !a.allFinite() || !b.allFinite()) continue;
        at.push_back(fine * (a.x() + (b.x() - a.x()) * (above / (above - below))));
      }
      std::sort(at.begin(), at.end());
      for (std::size_t k = 0; k + 1 < at.size(); k += 2)
        for (int x = pixel_within(at[k], columns_); x < columns_ && x < at[k + 1]; ++x)
          cover[static_cast<std::size_t>(x)] +=
              0.25 * (std::min(x + 1.0, at[k + 1]) - std::max<double>(x, at[k]));
    }
    for (int x = shown_[0]; x <= shown_[1]; ++x) blend(x, y, colour, cover[static_cast<std::size_t>(x)]);
  }
}

void Canvas::average(unsigned char* to) const {
  for (int y = height() - 1; y >= 0; --y)
    for (int x = 0; x < width(); ++x) {
      std::array<int, 3> sum{};
      for (int dy = 0; dy < fine; ++dy)
        for (int dx = 0; dx < fine; ++dx) {
          const Pixel& c = pixel_[index(x * fine + dx, y * fine + dy)];
          sum[0] += c.red;
          sum[1] += c.green;
          sum[2] += c.blue;
        }
      constexpr int count = fine * fine;
      for (const int part : sum) *to++ = static_cast<unsigned char>((part + count / 2) / count);
    }
}

std::string Canvas::bytes() const {
  if (is_svg_) return svg_ + "</svg>\n";
  vtkNew<vtkImageData> image;
  image->SetDimensions(width(), height(), 1);
  image->AllocateScalars(VTK_UNSIGNED_CHAR, 3);
  average(static_cast<unsigned char*>(image->GetScalarPointer()));
  vtkNew<vtkPNGWriter> writer;
  writer->SetInputData(image);
  writer->WriteToMemoryOn();
  writer->SetCompressionLevel(1);  // a third of the time of VTK's 5
  writer->Write();
  vtkUnsignedCharArray* result = writer->GetResult();
  if (result == nullptr || result->GetNumberOfValues() == 0)
    throw OutputError({.fact = "a picture could not be encoded",
                       .where = "writing pictures",
                       .why = "the PNG encoder returned nothing",
                       .remedy = "check the free memory"});
  return {reinterpret_cast<const char*>(result->GetPointer(0)),
          static_cast<std::size_t>(result->GetNumberOfValues())};
}

// -------------------------------------------------------------------------------------------------- numbers

double round_below(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value) + 1e-9));
  for (const double lead : {5.0, 2.0})
    if (lead * power <= value * (1.0 + 1e-9)) return lead * power;
  return power;
}

std::string tick_text(double value, double step) {
  const int decimals = std::clamp(static_cast<int>(-std::floor(std::log10(step) + 1e-9)), 0, 9);
  return fmt::format("{:.{}f}", value == 0.0 ? 0.0 : value, decimals);
}

}  // namespace dimple::draw

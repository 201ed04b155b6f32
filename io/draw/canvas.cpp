#include "io/draw/canvas.hpp"

#include <fmt/format.h>
#include <vtkAutoInit.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPNGWriter.h>
#include <vtkSmartPointer.h>
#include <vtkTextProperty.h>
#include <vtkTextRenderer.h>
#include <vtkUnsignedCharArray.h>

#include <array>
#include <cmath>
#include <optional>

#include "io/error.hpp"
#include "io/file.hpp"

VTK_MODULE_INIT(vtkRenderingFreeType)  // registers the text setter, and nothing that needs a display

namespace dimple::draw {

// -------------------------------------------------------------------------------------------------- drawing

Canvas::Canvas(int width, int height)
    : columns_(width * fine),
      rows_(height * fine),
      pixel_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), pixel_of(page)) {}

template <class Distance>
void Canvas::paint(const Rect& bounds, const Colour& colour, double opacity, Distance distance) {
  const int x0 = pixel_within((bounds.x - 1.0) * fine, columns_ - 1);
  const int y0 = pixel_within((bounds.y - 1.0) * fine, rows_ - 1);
  const int x1 = pixel_within((bounds.x + bounds.w + 1.0) * fine, columns_ - 1);
  const int y1 = pixel_within((bounds.y + bounds.h + 1.0) * fine, rows_ - 1);
  for (int y = y0; y <= y1; ++y)
    for (int x = x0; x <= x1; ++x) {
      const double d = distance((x + 0.5) / fine, (y + 0.5) / fine);
      blend(x, y, colour, opacity * std::clamp(0.5 - d * fine, 0.0, 1.0));
    }
}

void Canvas::rectangle(const Rect& r, const Colour& colour, double corner) {
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

void Canvas::disc(const Vec2& centre, double radius, const Colour& colour, double opacity) {
  paint({centre.x() - radius, centre.y() - radius, 2.0 * radius, 2.0 * radius}, colour, opacity,
        [radius, cx = centre.x(), cy = centre.y()](double x, double y) {
          return std::sqrt((x - cx) * (x - cx) + (y - cy) * (y - cy)) - radius;
        });
}

void Canvas::line(const Vec2& a, const Vec2& b, double thickness, const Colour& colour, double opacity) {
  const Vec2 along = b - a;
  const double length2 = std::max(along.squaredNorm(), 1e-12), r = thickness / 2.0;
  const Vec2 low = a.cwiseMin(b).array() - r, high = a.cwiseMax(b).array() + r;
  paint({low.x(), low.y(), high.x() - low.x(), high.y() - low.y()}, colour, opacity,
        [=, ax = a.x(), ay = a.y(), ux = along.x(), uy = along.y()](double x, double y) {
          const double t = std::clamp(((x - ax) * ux + (y - ay) * uy) / length2, 0.0, 1.0);
          const double dx = x - ax - t * ux, dy = y - ay - t * uy;
          return std::sqrt(dx * dx + dy * dy) - r;
        });
}

void Canvas::arrow(const Vec2& a, const Vec2& b, double thickness, const Colour& colour) {
  const double length = (b - a).norm();
  if (!(length > 0.0)) return;
  const double head = std::min(4.0 * thickness, 0.7 * length), half = 0.5 * head;
  const Vec2 along = (b - a) / length, across(-along.y(), along.x());
  line(a, b - 0.8 * head * along, thickness, colour);
  const Vec2 low = a.cwiseMin(b).array() - head, high = a.cwiseMax(b).array() + head;
  paint({low.x(), low.y(), high.x() - low.x(), high.y() - low.y()}, colour, 1.0, [&](double x, double y) {
    const Vec2 p(x, y);
    const double back = (b - p).dot(along), side = std::abs((p - b).dot(across));
    return std::max(back - head, (side * head - back * half) / std::hypot(head, half));
  });
}

void Canvas::polygon(const std::vector<Vec2>& corners, const Colour& colour, double grow) {
  if (corners.size() < 3) return;
  Vec2 low = corners[0], high = corners[0];
  for (const Vec2& p : corners) low = low.cwiseMin(p), high = high.cwiseMax(p);
  const double more = 4.0 * grow;  // sharp corners reach further than the edges
  paint({low.x() - more, low.y() - more, high.x() - low.x() + 2.0 * more, high.y() - low.y() + 2.0 * more},
        colour, 1.0, [&](double x, double y) {
          double outside = -1e9;
          for (std::size_t i = 0; i < corners.size(); ++i) {
            const Vec2 a = corners[i], along = (corners[(i + 1) % corners.size()] - a).normalized();
            outside = std::max(outside, (x - a.x()) * along.y() - (y - a.y()) * along.x());
          }
          return outside - grow;
        });
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

std::string png(const Canvas& canvas) {
  vtkNew<vtkImageData> image;
  image->SetDimensions(canvas.width(), canvas.height(), 1);
  image->AllocateScalars(VTK_UNSIGNED_CHAR, 3);
  canvas.average(static_cast<unsigned char*>(image->GetScalarPointer()));
  vtkNew<vtkPNGWriter> writer;
  writer->SetInputData(image);
  writer->WriteToMemoryOn();
  writer->SetCompressionLevel(1);  // a third of the time of VTK's 5
  writer->Write();
  vtkUnsignedCharArray* bytes = writer->GetResult();
  if (bytes == nullptr || bytes->GetNumberOfValues() == 0)
    throw OutputError({.fact = "a picture could not be encoded",
                       .where = "writing pictures",
                       .why = "the PNG encoder returned nothing",
                       .remedy = "check the free memory"});
  return {reinterpret_cast<const char*>(bytes->GetPointer(0)),
          static_cast<std::size_t>(bytes->GetNumberOfValues())};
}

void write_png(const std::filesystem::path& file, const Canvas& canvas) {
  write_file(file, png(canvas));
}

// ----------------------------------------------------------------------------------------------------- text

std::string printable(std::string_view text) {
  std::string clean;
  for (std::size_t i = 0; i < text.size();) {
    const auto byte = [&](std::size_t k) -> unsigned {
      const auto value = i + k < text.size() ? static_cast<unsigned char>(text[i + k]) : 0U;
      return k > 0 && (value & 0xC0U) != 0x80U ? 0U : value;  // 0: not the continuation of a character
    };
    std::size_t length = 1;
    bool known = byte(0) >= 0x20 && byte(0) < 0x7F;
    if (byte(0) >= 0xC2 && byte(0) <= 0xC5 && byte(1) != 0) {  // U+0080 to U+017F
      length = 2;
      known = byte(0) != 0xC2 || byte(1) >= 0xA0;
    } else if (byte(0) == 0xE2 && byte(1) != 0 && byte(2) != 0) {
      length = 3;
      const unsigned code = (byte(0) & 0x0FU) << 12 | (byte(1) & 0x3FU) << 6 | (byte(2) & 0x3FU);
      known = (code >= 0x2013 && code <= 0x2026) || code == 0x2212;  // dashes, quotes, dots, minus
    }
    const bool blank = text[i] == '\t' || text[i] == '\n' || text[i] == '\r';
    clean += known ? text.substr(i, length) : blank ? " " : "?";
    i += length;
  }
  return clean;
}

namespace {

vtkSmartPointer<vtkTextProperty> text_property(const Style& style) {
  vtkNew<vtkTextProperty> property;
  property->SetFontFamilyToArial();  // built into VTK: the same letters on every machine
  property->SetFontSize(static_cast<int>(std::lround(style.size * fine)));
  property->SetBold(style.bold ? 1 : 0);
  property->SetColor(1.0, 1.0, 1.0);
  return property;
}

constexpr int dots_per_inch = 72;  // a font size is then a number of pixels

/// Left, right, bottom and top of a text [fine pixels], from its start on the baseline.
std::optional<std::array<int, 4>> text_box(const std::string& clean, vtkTextProperty* property) {
  std::array<int, 4> box{};
  if (clean.find_first_not_of(' ') == std::string::npos ||
      !vtkTextRenderer::GetInstance()->GetBoundingBox(property, clean, box.data(), dots_per_inch,
                                                      vtkTextRenderer::FreeType))
    return std::nullopt;
  return box;
}

}  // namespace

double text_width(const std::string& text, const Style& style) {
  const auto box = text_box(printable(text), text_property(style));
  return box ? static_cast<double>((*box)[1] - (*box)[0] + 1) / fine : 0.0;
}

// Not through vtkFreeTypeTools: it drops all but ASCII.
void write(Canvas& canvas, const Vec2& at, const std::string& text, const Style& style, Align align) {
  const std::string clean = printable(text);
  const auto property = text_property(style);
  const auto box = text_box(clean, property);
  vtkNew<vtkImageData> image;
  std::array<int, 2> size{};
  if (!box || !(at.cwiseAbs().maxCoeff() < 10.0 * canvas.width()) ||
      !vtkTextRenderer::GetInstance()->RenderString(property, clean, image, size.data(), dots_per_inch,
                                                    vtkTextRenderer::FreeType))
    return;
  const double shift = align == Align::left ? 0.0 : align == Align::centre ? 0.5 : 1.0;
  const int left = static_cast<int>(std::lround(at.x() * fine - shift * ((*box)[1] - (*box)[0] + 1)));
  const int bottom = static_cast<int>(std::lround(at.y() * fine)) - (*box)[2];
  const int opacity = image->GetNumberOfScalarComponents() - 1;
  for (int y = 0; y < size[1]; ++y)
    for (int x = 0; x < size[0]; ++x) {
      const auto* value = static_cast<const unsigned char*>(image->GetScalarPointer(x, y, 0));
      canvas.blend(left + x, bottom - y, style.colour, value[opacity] / 255.0);
    }
}

std::vector<std::string> wrapped(const std::string& line, double room, const Style& style) {
  std::vector<std::string> parts;
  std::string part, word;
  const auto place = [&] {
    if (word.empty()) return;
    const std::string longer = part.empty() ? word : part + ' ' + word;
    if (text_width(longer, style) <= room) {
      part = longer;
    } else {
      if (!part.empty()) parts.push_back(part);
      part = word;
      while (part.size() > 8 && text_width(part, style) > room) {
        const double keep = room / text_width(part, style) * 0.97;
        auto cut = static_cast<std::size_t>(keep * static_cast<double>(part.size()));
        cut = std::clamp<std::size_t>(cut, 4, part.size() - 1);
        while (cut > 1 && (static_cast<unsigned char>(part[cut]) & 0xC0U) == 0x80U) --cut;
        parts.push_back(part.substr(0, cut));
        part.erase(0, cut);
      }
    }
    word.clear();
  };
  for (const char c : printable(line)) {
    if (c == ' ')
      place();
    else
      word += c;
  }
  place();
  if (!part.empty()) parts.push_back(part);
  return parts;
}

std::string shortened(const std::string& text, double room, const Style& style) {
  std::string part = printable(text);
  if (part.size() <= 500 && text_width(part, style) <= room) return part;
  part.resize(std::min<std::size_t>(part.size(), 500));  // more never fits
  while (!part.empty() && text_width(part + "...", style) > room) {
    while (part.size() > 1 && (static_cast<unsigned char>(part.back()) & 0xC0U) == 0x80U) part.pop_back();
    part.pop_back();
  }
  return part + "...";
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

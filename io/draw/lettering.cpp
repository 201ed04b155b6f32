#include <fmt/format.h>
#include <fmt/ranges.h>
#include <vtkAutoInit.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkSmartPointer.h>
#include <vtkStdString.h>
#include <vtkTextProperty.h>
#include <vtkTextRenderer.h>

#include <cmath>
#include <optional>
#include <span>

#include "io/draw/canvas.hpp"
#include "io/text.hpp"

VTK_MODULE_INIT(vtkRenderingFreeType)  // registers the text setter, and nothing that needs a display

namespace dimple::draw {

namespace {

/// The characters for which `shown` is true; a blank for tabs and ends of lines; '?' for others and for bytes
/// that are not UTF-8.
template <class Shown>
std::string characters(std::string_view text, const Shown& shown) {
  std::string clean;
  while (!text.empty()) {
    const std::size_t length = length_of_character(text);
    const std::string_view c = text.substr(0, std::max<std::size_t>(length, 1));
    if (length > 0 && c >= " " && c != "\x7F" && shown(c))
      clean += c;
    else
      clean += c == "\t" || c == "\n" || c == "\r" ? ' ' : '?';
    text.remove_prefix(c.size());
  }
  return clean;
}

/// Characters of the built-in font: Latin letters up to U+017F, dashes, quotes, dots and the minus.
std::string lettered(std::string_view text) {
  return characters(text, [](std::string_view c) {
    return c <= "\x7E" || (c >= "\xC2\xA0" && c <= "\xC5\xBF") ||
           (c >= "\xE2\x80\x93" && c <= "\xE2\x80\xA6") || c == "\xE2\x88\x92";
  });
}

/// Text for XML: allowed characters, with its special signs escaped.
std::string escaped(std::string_view text) {
  const auto allowed = [](std::string_view c) {
    return c <= "\x7E" || (c >= "\xC2\xA0" && c != "\xEF\xBF\xBE" && c != "\xEF\xBF\xBF");
  };
  std::string clean;
  for (const char c : characters(text, allowed)) {
    const char* as = c == '&'   ? "&amp;"
                     : c == '<' ? "&lt;"
                     : c == '>' ? "&gt;"
                     : c == '"' ? "&quot;"
                                : nullptr;
    clean += as != nullptr ? std::string(as) : std::string(1, c);
  }
  return clean;
}

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
      !vtkTextRenderer::GetInstance()->GetBoundingBox(property, vtkStdString(clean), box.data(),
                                                      dots_per_inch, vtkTextRenderer::FreeType))
    return std::nullopt;
  return box;
}

}  // namespace

double text_width(const std::string& text, const Style& style) {
  const auto box = text_box(lettered(text), text_property(style));
  return box ? static_cast<double>((*box)[1] - (*box)[0] + 1) / fine : 0.0;
}

// Without vtkFreeTypeTools, which drops all but ASCII.
void Canvas::set_pixels_of(const std::string& shown, const Vec2& at, const Style& style, Align align) {
  const std::string clean = lettered(shown);
  const auto property = text_property(style);
  const auto box = text_box(clean, property);
  vtkNew<vtkImageData> image;
  std::array<int, 2> size{};
  if (!box || !(at.cwiseAbs().maxCoeff() < 10.0 * width()) ||
      !vtkTextRenderer::GetInstance()->RenderString(property, vtkStdString(clean), image, size.data(),
                                                    dots_per_inch, vtkTextRenderer::FreeType))
    return;
  const double shift = align == Align::left ? 0.0 : align == Align::centre ? 0.5 : 1.0;
  const int left = static_cast<int>(std::lround(at.x() * fine - shift * ((*box)[1] - (*box)[0] + 1)));
  const int bottom = static_cast<int>(std::lround(at.y() * fine)) - (*box)[2];
  const int opacity = image->GetNumberOfScalarComponents() - 1;
  for (int y = 0; y < size[1]; ++y)
    for (int x = 0; x < size[0]; ++x) {
      const auto* value = static_cast<const unsigned char*>(image->GetScalarPointer(x, y, 0));
      blend(left + x, bottom - y, style.colour, value[opacity] / 255.0);
    }
}

void Canvas::text(const Vec2& at, const std::string& text, const Style& style, Align align, double room) {
  constexpr double lift = 0.19;  // pixel text is higher than the line by this fraction of its size
  if (lettered(text).find_first_not_of(' ') == std::string::npos) return;
  const bool fits = room == any_room || text_width(text, style) <= room;
  const std::string shown = fits ? text : shortened(text, room, style);
  if (!is_svg_) return set_pixels_of(shown, at, style, align);
  const char* anchor = align == Align::left     ? ""
                       : align == Align::centre ? " text-anchor=\"middle\""
                                                : " text-anchor=\"end\"";
  // A character that the built-in font lacks was measured as '?': its line keeps its natural width.
  const std::string measured =
      lettered(shown) != shown
          ? ""
          : fmt::format(" textLength=\"{:.2f}\" lengthAdjust=\"spacingAndGlyphs\"", text_width(shown, style));
  svg_ += fmt::format("<text x=\"{:.2f}\" y=\"{:.2f}\" font-size=\"{:g}\"{}{}{} fill=\"{}\">{}{}</text>\n",
                      at.x(), at.y() - lift * style.size, style.size,
                      style.bold ? " font-weight=\"bold\"" : "", anchor, measured, in_hex(style.colour),
                      fits ? "" : fmt::format("<title>{}</title>", escaped(text)), escaped(shown));
}

namespace {

std::vector<std::string> words_of(const std::string& line) {
  std::vector<std::string> words(1);
  for (const char c : lettered(line))
    if (c != ' ')
      words.back() += c;
    else if (!words.back().empty())
      words.emplace_back();
  if (words.back().empty()) words.pop_back();
  return words;
}

/// The longest beginning of the words that fits, or all: found by bisection, as measuring takes long.
std::size_t words_that_fit(std::span<const std::string> words, double room, const Style& style) {
  const auto fit = [&](std::size_t count) {
    return text_width(fmt::format("{}", fmt::join(words.first(count), " ")), style) <= room;
  };
  std::size_t fits = 0, too_many = words.size() + 1;
  for (std::size_t count = std::min<std::size_t>(words.size(), 64); fits + 1 < too_many;
       count = too_many > words.size() ? std::min(2 * fits, words.size()) : (fits + too_many) / 2)
    (fit(count) ? fits : too_many) = count;
  return fits;
}

}  // namespace

std::vector<std::string> wrapped(const std::string& line, double room, const Style& style) {
  std::vector<std::string> parts, words = words_of(line);
  for (std::span<std::string> left(words); !left.empty();) {
    if (const std::size_t count = words_that_fit(left, room, style); count > 0) {
      parts.push_back(fmt::format("{}", fmt::join(left.first(count), " ")));
      left = left.subspan(count);
      continue;
    }
    std::string& word = left.front();
    if (word.size() <= 8) {
      parts.push_back(word);
      left = left.subspan(1);
      continue;
    }
    const double keep = room / text_width(word, style) * 0.97;
    auto cut = static_cast<std::size_t>(keep * static_cast<double>(word.size()));
    cut = std::clamp<std::size_t>(cut, 4, word.size() - 1);
    while (cut > 1 && (static_cast<unsigned char>(word[cut]) & 0xC0U) == 0x80U) --cut;
    parts.push_back(word.substr(0, cut));
    word.erase(0, cut);
  }
  return parts;
}

std::string shortened(const std::string& text, double room, const Style& style) {
  std::string part = lettered(text);
  if (part.size() <= 500 && text_width(part, style) <= room) return part;
  part.resize(std::min<std::size_t>(part.size(), 500));  // more never fits
  while (!part.empty() && text_width(part + "...", style) > room) {
    while (part.size() > 1 && (static_cast<unsigned char>(part.back()) & 0xC0U) == 0x80U) part.pop_back();
    part.pop_back();
  }
  return part + "...";
}

}  // namespace dimple::draw

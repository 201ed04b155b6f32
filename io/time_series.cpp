#include <fmt/format.h>

#include <system_error>
#include <utility>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/vtk_files.hpp"

namespace dimple {

namespace fs = std::filesystem;

namespace {

std::string xml_text(std::string_view text) {
  std::string escaped;
  for (const char c : text)
    escaped += c == '&'   ? "&amp;"
               : c == '<' ? "&lt;"
               : c == '>' ? "&gt;"
               : c == '"' ? "&quot;"
                          : std::string(1, c);
  return escaped;
}

}  // namespace

TimeSeries::TimeSeries(fs::path pvd, std::string suffix) : pvd_(std::move(pvd)), suffix_(std::move(suffix)) {
  if (!suffix_.starts_with('.')) suffix_ = fmt::format(".{}", suffix_);
}

fs::path TimeSeries::frame(std::size_t number) const {
  const std::string stem = pvd_.stem().string();
  return pvd_.parent_path() / stem / fmt::format("{}_{:04}{}", stem, number, suffix_);
}

fs::path TimeSeries::next_frame() const {
  const fs::path folder = frame(0).parent_path();
  std::error_code failure;
  fs::create_directories(folder, failure);
  if (failure)
    throw OutputError({.fact = fmt::format("the folder {} cannot be made", folder.string()),
                       .where = fmt::format("writing the frames of {}", pvd_.string()),
                       .why = failure.message(),
                       .remedy = "name another output folder, or make this one writable"});
  return frame(frames_.size());
}

void TimeSeries::resume(const std::vector<double>& times_s) {
  std::error_code ignored;
  frames_.clear();
  for (const double time_s : times_s) {
    const fs::path earlier = frame(frames_.size());
    if (!fs::is_regular_file(earlier, ignored)) disappeared(earlier);
    frames_.emplace_back(time_s, earlier.lexically_relative(pvd_.parent_path()).generic_string());
  }
  // The list first: it never names files that were removed.
  if (frames_.empty())
    fs::remove(pvd_, ignored);
  else
    write_list();
  for (std::size_t k = frames_.size(); fs::remove(frame(k), ignored);) ++k;
}

void TimeSeries::disappeared(const fs::path& frame) const {
  throw OutputError({.fact = fmt::format("the frame {} has disappeared", frame.string()),
                     .where = fmt::format("listing it in {}", pvd_.string()),
                     .why = "it was written by this run; something else moved or deleted it",
                     .remedy = "let nothing else work in that folder; start again with --force"});
}

void TimeSeries::add(double time_s) {
  const fs::path written = next_frame();
  std::error_code ignored;
  if (!fs::is_regular_file(written, ignored)) disappeared(written);
  frames_.emplace_back(time_s, written.lexically_relative(pvd_.parent_path()).generic_string());
  write_list();
}

void TimeSeries::write_list() const {
  // No library: VTK has no writer for this list (it is ParaView's), and it is a few lines of text.
  std::string list =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n  <Collection>\n";
  for (const auto& [time, name] : frames_)
    list += fmt::format("    <DataSet timestep=\"{}\" group=\"\" part=\"0\" file=\"{}\"/>\n", time,
                        xml_text(name));
  list += "  </Collection>\n</VTKFile>\n";
  write_file(pvd_, list);
}

}  // namespace dimple

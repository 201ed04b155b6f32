#include <fmt/chrono.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <fstream>

#include "io/file.hpp"
#include "tests/bench/bench.hpp"

namespace dimple {
namespace {

std::string processor() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string text; std::getline(file, text);)
    if (text.rfind("model name", 0) == 0) return text.substr(std::min(text.size(), text.find(':') + 2));
  return "unknown";
}

// "Intel(R) Core(TM) i7-8550U CPU @ 1.80GHz" -> "Intel-Core-i7-8550U-CPU-1.80GHz"
std::string as_file_name(std::string name) {
  for (const std::string mark : {"(R)", "(TM)", "(r)", "(tm)"})
    for (std::size_t at; (at = name.find(mark)) != std::string::npos;) name.erase(at, mark.size());
  std::string result;
  for (const char c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) || c == '.')
      result += c;
    else if (!result.empty() && result.back() != '-')
      result += '-';
  return result;
}

const char* memory_for(double bytes) {
  const auto away = [bytes](const Memory& m) {
    return std::abs(std::log(bytes / static_cast<double>(m.bytes)));
  };
  const std::vector<Memory> all = memories();
  return std::min_element(all.begin(), all.end(),
                          [&](const Memory& a, const Memory& b) { return away(a) < away(b); })
      ->name;
}

}  // namespace

Results::Results() : ConsoleReporter(isatty(STDOUT_FILENO) ? OO_ColorTabular : OO_Tabular) {}

bool Results::ReportContext(const Context& context) {
  name_field_width_ = std::max<std::size_t>(context.name_field_width, 48);
  return ConsoleReporter::ReportContext(context);
}

Results::Line& Results::line(const std::string& name) {
  const auto found =
      std::find_if(lines_.begin(), lines_.end(), [&](const Line& l) { return l.name == name; });
  return found != lines_.end() ? *found : lines_.emplace_back(Line{.name = name});
}

void Results::ReportRuns(const std::vector<Run>& runs) {
  ConsoleReporter::ReportRuns(runs);
  for (const Run& run : runs) {
    if (run.error_occurred) continue;
    const bool only =
        run.run_type == Run::RT_Iteration;  // one repetition; otherwise all are printed before their median
    Line& now = line(run.run_name.function_name);
    if (run.aggregate_name == "cv") now.spread = run.real_accumulated_time;
    if (!only && run.aggregate_name != "median") continue;
    now.time_us = run.GetAdjustedRealTime() * 1e6 / benchmark::GetTimeUnitMultiplier(run.time_unit);
    const auto counter = [&](const char* name) {
      const auto at = run.counters.find(name);
      return at == run.counters.end() ? 0.0 : at->second.value;
    };
    now.bytes_per_second = counter("bytes_per_second");
    now.flops = counter("FLOPS");
  }
}

std::string Results::write(const std::string& folder, const std::string& version,
                           const std::string& facts) const {
  const benchmark::CPUInfo& cpu = benchmark::CPUInfo::Get();
  const std::string name = processor();
  std::string text = fmt::format("# machine: {}\n# cores: {}\n", name, cpu.num_cpus);
  for (const auto& c : cpu.caches)
    text +=
        fmt::format("# cache: L{} {}, {} KiB, shared by {}\n", c.level, c.type, c.size / 1024, c.num_sharing);
  text += fmt::format("# compiler: {} {}\n# version: {}\n# date: {:%Y-%m-%d}\n",
#ifdef __clang__
                      "clang", __clang_version__,
#else
                      "gcc", __VERSION__,
#endif
                      version, fmt::gmtime(std::time(nullptr)));
  text += facts;
  text +=
      "# time_us: median of the repetitions, wall clock; spread: standard deviation / mean\n"
      "# memory_roof: achieved part of the roof/read_* whose size is nearest to what one evaluation passes\n"
      "# arithmetic_roof: achieved part of roof/multiply_add_*\n"
      "benchmark,time_us,spread,GB_per_s,GFLOP_per_s,memory_roof,arithmetic_roof\n";

  const auto roof = [&](const std::string& of) {
    const auto found =
        std::find_if(lines_.begin(), lines_.end(), [&](const Line& l) { return l.name == of; });
    return found == lines_.end() ? 0.0 : std::max(found->bytes_per_second, found->flops);
  };
  const auto part = [](double a, double b) { return a > 0.0 && b > 0.0 ? fmt::format("{:.3f}", a / b) : ""; };
  const auto number = [](double a) { return a > 0.0 ? fmt::format("{:.4g}", a * 1e-9) : ""; };
  for (const Line& l : lines_) {
    double memory = 0.0, arithmetic = 0.0;
    if (l.name.starts_with("force/") || l.name.starts_with("reference/")) {
      const std::string threads = l.name.substr(l.name.rfind('/') + 1);
      const double bytes = l.bytes_per_second * l.time_us * 1e-6;
      memory = roof(fmt::format("roof/read_{}/{}", memory_for(bytes), threads));
      const bool is_single = l.name.find("single") != std::string::npos;
      arithmetic = roof(fmt::format("roof/multiply_add_{}/{}", is_single ? "single" : "double", threads));
    }
    text +=
        fmt::format("{},{:.5g},{:.3f},{},{},{},{}\n", l.name, l.time_us, l.spread, number(l.bytes_per_second),
                    number(l.flops), part(l.bytes_per_second, memory), part(l.flops, arithmetic));
  }
  std::filesystem::create_directories(folder);
  const std::filesystem::path file = std::filesystem::path(folder) / (as_file_name(name) + ".csv");
  write_file(file, text);
  return file.string();
}

}  // namespace dimple

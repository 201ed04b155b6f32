#include "apps/commands/describe.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "apps/run/summary.hpp"
#include "apps/scene/option.hpp"

namespace dimple {
namespace {

std::map<std::string, std::vector<std::string>> choices_by_flag() {
  std::map<std::string, std::vector<std::string>> result;
  for (const Option& option : usual_options())
    if (!option.flag.empty()) result[option.flag] = option.choices.empty() ? option.words : option.choices;
  return result;
}

std::vector<const CLI::App*> commands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* command) { return !command->get_group().empty(); });
}

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size())
    text.replace(at, what.size(), by);
  return text;
}

// Text for roff: hyphens can be searched, and no line is read as a request.
std::string roff(const std::string& text) {
  std::string result = replaced(replaced(text, "\\", "\\e"), "-", "\\-");
  for (const char* mark : {".", "'"}) {
    if (result.starts_with(mark)) result.insert(0, "\\&");
    result = replaced(result, std::string("\n") + mark, std::string("\n\\&") + mark);
  }
  return result;
}

std::string man_flag(const FlagWords& flag) {
  std::string names;
  for (const std::string& name : flag.names)
    names += (names.empty() ? "\\fB" : ", \\fB") + roff(name) + "\\fR";
  if (flag.takes_value && !flag.positional)
    names += " \\fI" + roff(flag.value.empty() ? "VALUE" : flag.value) + "\\fR";
  return fmt::format(".TP\n{}\n{}{}\n", names, roff(flag.help), flag.required ? " (required)" : "");
}

// Text in single quotes of a shell.
std::string in_quotes(const std::string& text) {
  return "'" + replaced(text, "'", "'\\''") + "'";
}

std::string first_line(const std::string& help) {
  const std::string line = help.substr(0, help.find_first_of(";\n"));
  return line.substr(0, line.find(" ("));
}

std::vector<std::string> names_of(const std::vector<FlagWords>& flags) {
  std::vector<std::string> names;
  for (const FlagWords& flag : flags)
    if (!flag.positional) names.insert(names.end(), flag.names.begin(), flag.names.end());
  return names;
}

// Choices of an argument, as for `dimple completion`; empty: file names.
std::vector<std::string> words_of_argument(const std::vector<FlagWords>& flags) {
  for (const FlagWords& flag : flags)
    if (flag.positional) return flag.choices;
  return {};
}

std::string for_bash(const CLI::App& app) {
  std::vector<std::string> commands;
  std::string cases;
  for (const CLI::App* command : commands_of(app)) {
    commands.push_back(command->get_name());
    const std::vector<FlagWords> flags = flags_of(*command);
    std::string values;
    for (const FlagWords& flag : flags)
      if (!flag.choices.empty())
        values += fmt::format("        {}) words=\"{}\" ;;\n", fmt::join(flag.names, "|"),
                              fmt::join(flag.choices, " "));
      else if (flag.takes_value && !flag.positional)
        values += fmt::format("        {}) return ;;\n", fmt::join(flag.names, "|"));
    std::vector<std::string> words = words_of_argument(flags);
    for (const std::string& name : names_of(flags)) words.push_back(name);
    cases += fmt::format("    {})\n      words=\"{}\"\n", command->get_name(), fmt::join(words, " "));
    if (!values.empty()) cases += "      case \"$before\" in\n" + values + "      esac\n";
    cases += "      ;;\n";
  }
  return fmt::format(R"(# bash completion for dimple, made by `dimple completion bash`
_dimple() {{
  local now="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" words=""
  COMPREPLY=()
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "{} --help --help-all --version" -- "$now"))
    return
  fi
  case "${{COMP_WORDS[1]}}" in
{}  esac
  # Where nothing fits, the names of files are offered.
  if [ "${{words#--}}" = "$words" ] && [ "${{words#-}}" = "$words" ] || [ "${{now#-}}" != "$now" ]; then
    COMPREPLY=($(compgen -W "$words" -- "$now"))
  fi
}}
complete -o default -F _dimple dimple
)",
                     fmt::join(commands, " "), cases);
}

std::string for_zsh(const CLI::App& app) {
  const auto plain = [](const std::string& text) {
    return replaced(replaced(replaced(replaced(text, "\\", "\\\\"), "[", "\\["), "]", "\\]"), ":", "\\:");
  };
  std::string commands, cases;
  for (const CLI::App* command : commands_of(app)) {
    commands +=
        fmt::format("    {}\n", in_quotes(command->get_name() + ":" + plain(command->get_description())));
    cases += fmt::format("    {})\n      _arguments -s \\\n", command->get_name());
    for (const FlagWords& flag : flags_of(*command)) {
      if (flag.positional) continue;
      for (const std::string& name : flag.names) {
        std::string line = fmt::format("{}[{}]", name, plain(first_line(flag.help)));
        if (!flag.choices.empty())
          line += fmt::format(":value:({})", fmt::join(flag.choices, " "));
        else if (flag.takes_value)
          line += ":value:_files";
        cases += fmt::format("        {} \\\n", in_quotes(line));
      }
    }
    const std::vector<std::string> words = words_of_argument(flags_of(*command));
    cases += words.empty() ? "        '*:file:_files'\n      ;;\n"
                           : fmt::format("        '1:word:({})'\n      ;;\n", fmt::join(words, " "));
  }
  return fmt::format(R"(#compdef dimple
# zsh completion for dimple, made by `dimple completion zsh`
_dimple() {{
  local -a commands
  commands=(
{}  )
  if (( CURRENT == 2 )); then
    _describe command commands
    return
  fi
  local command=$words[2]
  shift words
  (( CURRENT-- ))
  case $command in
{}  esac
}}
_dimple "$@"
)",
                     commands, cases);
}

std::string for_fish(const CLI::App& app) {
  std::string text = "# fish completion for dimple, made by `dimple completion fish`\n";
  for (const CLI::App* command : commands_of(app)) {
    text += fmt::format("complete -c dimple -n __fish_use_subcommand -f -a {} -d {}\n", command->get_name(),
                        in_quotes(command->get_description()));
    const std::string here =
        fmt::format("complete -c dimple -n '__fish_seen_subcommand_from {}'", command->get_name());
    const auto one_of = [](const std::vector<std::string>& words) {
      return fmt::format(" -f -a '{}'\n", fmt::join(words, " "));
    };
    for (const FlagWords& flag : flags_of(*command)) {
      if (flag.positional) {
        if (!flag.choices.empty()) text += here + one_of(flag.choices);
        continue;
      }
      std::string names;
      for (const std::string& name : flag.names)
        names += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
      if (flag.takes_value) names += " -r";
      text += fmt::format("{}{} -d {}\n", here, names, in_quotes(first_line(flag.help)));
      // Choices are listed separately, as the flag's description does not apply to each.
      if (!flag.choices.empty()) text += here + names + one_of(flag.choices);
    }
  }
  return text;
}

}  // namespace

std::vector<FlagWords> flags_of(const CLI::App& command) {
  static const auto choices = choices_by_flag();
  std::vector<FlagWords> result;
  for (const CLI::Option* option : command.get_options()) {
    if (option->get_group().empty()) continue;
    FlagWords flag{.names = {},
                   .value = option->get_type_name(),
                   .help = option->get_description(),
                   .group = option->get_group(),
                   .choices = {},
                   .takes_value = option->get_items_expected_max() > 0 && option->get_type_size_max() > 0,
                   .positional = option->get_positional() && !option->nonpositional(),
                   .required = option->get_required()};
    if (flag.positional) flag.names = {option->get_name(true, false)};
    for (const std::string& name : option->get_snames()) flag.names.push_back("-" + name);
    for (const std::string& name : option->get_lnames()) {
      flag.names.push_back("--" + name);
      if (const auto known = choices.find("--" + name); known != choices.end()) flag.choices = known->second;
    }
    if (flag.value.find('|') != std::string::npos) {
      std::istringstream words(flag.value);
      for (std::string one; std::getline(words, one, '|');) flag.choices.push_back(one);
    }
    result.push_back(std::move(flag));
  }
  return result;
}

std::string man_page(const CLI::App& app, const CLI::App* command) {
  const CLI::App& subject = command ? *command : app;
  const std::string name = command ? "dimple-" + command->get_name() : "dimple";
  std::string upper = name;
  std::transform(upper.begin(), upper.end(), upper.begin(), [](unsigned char c) { return std::toupper(c); });
  const std::vector<FlagWords> flags = flags_of(subject);
  std::string text = fmt::format(".TH {} 1 \"\" \"dimple {}\" \"User Commands\"\n.SH NAME\n{} \\- {}\n",
                                 roff(upper), DIMPLE_VERSION, roff(name), roff(subject.get_description()));
  text += fmt::format(".SH SYNOPSIS\n.B dimple{}\n", command ? " " + command->get_name() : "");
  if (!command) text += ".I COMMAND\n";
  text += "[\\fIOPTIONS\\fR]\n";
  std::string arguments;
  std::vector<std::string> groups;
  for (const FlagWords& flag : flags) {
    if (flag.positional) {
      text += fmt::format(".I {}\n", roff(flag.names.front()));
      arguments += man_flag(flag);
    } else if (std::find(groups.begin(), groups.end(), flag.group) == groups.end()) {
      groups.push_back(flag.group);
    }
  }
  if (!arguments.empty()) text += ".SH ARGUMENTS\n" + arguments;
  if (!command) {
    text += ".SH COMMANDS\n";
    for (const CLI::App* known : commands_of(app))
      text += fmt::format(".TP\n.B {}\n{}\n", roff(known->get_name()), roff(known->get_description()));
  }
  text += ".SH OPTIONS\n";
  for (const std::string& group : groups) {
    if (groups.size() > 1) text += fmt::format(".SS {}\n", roff(group == "Options" ? "Common" : group));
    for (const FlagWords& flag : flags)
      if (!flag.positional && flag.group == group) text += man_flag(flag);
  }
  if (command)
    text +=
        ".SH SEE ALSO\n.BR dimple (1);\n.B dimple options\nlists every option with its unit, default and "
        "range.\n";
  else
    text += ".SH NOTES\n.nf\n" + roff(app.get_footer()) + "\n.fi\n";
  return text;
}

std::string completion_for(const CLI::App& app, const std::string& shell) {
  return shell == "bash"   ? for_bash(app)
         : shell == "zsh"  ? for_zsh(app)
         : shell == "fish" ? for_fish(app)
                           : "";
}

std::string image_as_json(const std::filesystem::path& file, const LabelImage& image) {
  const auto three = [](const Vec3& v) { return Json::array({v.x(), v.y(), v.z()}); };
  Json out = {{"file", file.string()},
              {"format", image.format},
              {"orientation", image.orientation},
              {"size", {image.stored_size[0], image.stored_size[1], image.stored_size[2]}},
              {"spacing_mm", three(image.stored_spacing)},
              {"labels", Json::array()},
              {"warnings", image.warnings}};
  for (const LabelMeasure& l : measure_labels(image))
    out["labels"].push_back({{"value", l.value},
                             {"name", l.name},
                             {"voxels", l.voxels},
                             {"volume_mm3", l.volume_mm3},
                             {"centre_mm", three(l.centre_mm)},
                             {"pieces", l.pieces},
                             {"touches_border", l.meets_border}});
  return as_text(out);
}

}  // namespace dimple

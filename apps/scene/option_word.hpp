#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Number in a word of an option, with its bounds, both allowed, in the unit of bare numbers.
struct WordNumber {
  std::string name;
  std::string unit = {};
  double scale = 1.0;  ///< factor from that unit to the one of the result: 1e-3 from mm to m
  double least = -std::numeric_limits<double>::infinity();
  double most = std::numeric_limits<double>::infinity();
  bool least_excluded = false;
  bool needs_unit = false;
  std::optional<double> usual = {};  ///< default of a key=value; empty: it is required
  /// Bounds as multiples of the word's first number, which is above zero; none where the least is 0.
  double least_of_first = 0.0, most_of_first = std::numeric_limits<double>::infinity();
};

/// Form kind:number,number,key=number of a word.
struct WordForm {
  std::string kind = {};  ///< empty: the word begins with a number or with a side of the patient
  std::vector<WordNumber> numbers = {};
  std::string example = {};  ///< as a user writes it; empty: the form with the names of its numbers
  std::vector<WordNumber> keys = {};
  char after_kind = ':', between = ',';
  bool is_side = false;    ///< a side of the patient replaces the first three numbers
  std::string names = {};  ///< placeholder for names in place of numbers: "NAME"
};

/// Words that an option accepts.
struct WordTable {
  std::string what;  ///< subject of a message: "the tool"
  std::vector<WordForm> forms;
  std::string unknown = {};  ///< reason to refuse a word of no form; empty: it has none of the forms
  bool is_file = false;      ///< the name of a surface file is a word too
};

/// Word that was read, with the parts of a message that refuses it.
struct OptionWord {
  std::string kind = {};            ///< kind of its form; "file" for a surface file
  std::vector<double> number = {};  ///< numbers, then keys, in the order of the form, scaled
  std::vector<std::string> name = {};
  bool is_side = false;  ///< its first three numbers are the unit vector of a side, in LPS
  std::string text = {}, where = {}, subject = {}, remedy = {};

  Vec3 three(std::size_t from = 0) const { return {number[from], number[from + 1], number[from + 2]}; }
};

/// Reads a word. `where`: the option. `of`: owner of the word: "the wall 'skull'". Throws UsageError.
OptionWord parse_word(const WordTable& table, const std::string& text, const std::string& where,
                      const std::string& of = {});

/// Throws UsageError about a word that was read. `remedy` replaces the examples of its table.
[[noreturn]] void refuse_word(const OptionWord& word, const std::string& fact, const std::string& why,
                              const std::string& remedy = {});

/// Parts between separators, trimmed, without empty ones.
std::vector<std::string> parts_between(const std::string& text, char separator);

/// Length above zero, in mm, of at most `most_mm`.
WordNumber length_number(const std::string& name, double scale, double most_mm);
/// Position x, y, z in mm; ball_numbers() adds a radius.
std::vector<WordNumber> place_numbers(double scale = 1.0);
std::vector<WordNumber> ball_numbers();
/// Three components of a direction.
std::vector<WordNumber> direction_numbers();
std::vector<WordNumber> joined(std::vector<WordNumber> first, const std::vector<WordNumber>& then);

}  // namespace dimple

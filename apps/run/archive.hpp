#pragma once

#include <Eigen/Core>
#include <array>
#include <concepts>
#include <cstring>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace dimple {

/// Archive of structs as JSON with binary arrays, restored to the same bits. Each struct has one list of
/// members, in its order, for both directions:
///
///     template <class Archive, Like<Retry> T>
///     void members(Archive& io, T& retry) {
///       auto& [code, depth, what] = retry;
///       io(code, depth, what);
///     }
///
/// A structured binding of a struct with one more member does not compile until the list has that member too.
template <class T, class Of>
concept Like = std::same_as<std::remove_const_t<T>, Of>;

namespace archive {

using Json = nlohmann::json;

template <class T>
constexpr bool is_matrix = std::is_base_of_v<Eigen::EigenBase<T>, T>;
template <class T>
constexpr bool is_optional = false;
template <class T>
constexpr bool is_optional<std::optional<T>> = true;
template <class T>
constexpr bool is_map = false;
template <class K, class V>
constexpr bool is_map<std::map<K, V>> = true;
template <class T>
constexpr bool is_few = false;  // numbers of a fixed count
template <class T, std::size_t n>
constexpr bool is_few<std::array<T, n>> = std::is_arithmetic_v<T>;
template <class T>
constexpr bool is_plain = std::is_arithmetic_v<T> || std::is_same_v<T, std::string> || is_few<T> ||
                          std::is_same_v<T, std::map<std::string, std::string>>;
template <class T>
constexpr bool is_bytes = false;  // items are stored as in memory
template <class T>
constexpr bool is_bytes<std::vector<T>> = std::is_trivially_copyable_v<T>;
template <class T>
constexpr bool is_list = false;
template <class T>
constexpr bool is_list<std::vector<T>> = !std::is_trivially_copyable_v<T>;
template <class T>
constexpr bool is_list<std::deque<T>> = true;

inline Json::binary_t bytes_of(const void* data, std::size_t size) {
  std::vector<std::uint8_t> bytes(size);
  if (size > 0) std::memcpy(bytes.data(), data, size);
  return Json::binary_t(std::move(bytes));
}

struct Writer {
  Json json = Json::array();

  template <class... T>
  void operator()(const T&... values) {
    (json.push_back(one(values)), ...);
  }

  template <class T>
  static Json one(const T& value) {
    if constexpr (is_plain<T>) {
      return value;
    } else if constexpr (std::is_enum_v<T>) {
      return static_cast<std::int64_t>(value);
    } else if constexpr (is_matrix<T>) {
      return {value.rows(), value.cols(),
              bytes_of(value.data(), sizeof(*value.data()) * static_cast<std::size_t>(value.size()))};
    } else if constexpr (is_optional<T>) {
      Json list = Json::array();
      if (value) list.push_back(one(*value));
      return list;
    } else if constexpr (is_map<T>) {
      Json list = Json::array();
      for (const auto& [key, item] : value) list.push_back(Json::array({one(key), one(item)}));
      return list;
    } else if constexpr (is_list<T>) {
      Json list = Json::array();
      for (const auto& item : value) list.push_back(one(item));
      return list;
    } else if constexpr (is_bytes<T>) {
      return bytes_of(value.data(), sizeof(*value.data()) * value.size());
    } else {
      Writer inner;
      members(inner, value);
      return std::move(inner.json);
    }
  }
};

struct Reader {
  const Json& json;
  std::size_t next = 0;

  template <class... T>
  void operator()(T&... values) {
    (one(json.at(next++), values), ...);
  }

  template <class T>
  static void one(const Json& from, T& value) {
    if constexpr (is_plain<T>) {
      value = from.get<T>();
    } else if constexpr (std::is_enum_v<T>) {
      value = static_cast<T>(from.get<std::int64_t>());
    } else if constexpr (is_matrix<T>) {
      matrix(from, value);
    } else if constexpr (is_optional<T>) {
      value.reset();
      if (!from.empty()) one(from.at(0), value.emplace());
    } else if constexpr (is_map<T>) {
      for (const Json& item : from) {
        typename T::key_type key{};
        one(item.at(0), key);
        one(item.at(1), value[key]);
      }
    } else if constexpr (is_list<T>) {
      for (const Json& item : from) one(item, value.emplace_back());
    } else if constexpr (is_bytes<T>) {
      const Json::binary_t& data = from.get_binary();
      value.resize(data.size() / sizeof(*value.data()));
      if (!value.empty()) std::memcpy(value.data(), data.data(), sizeof(*value.data()) * value.size());
    } else {
      Reader inner{from};
      members(inner, value);
    }
  }

  template <class T>
  static void matrix(const Json& from, T& value) {
    const auto rows = from.at(0).get<Eigen::Index>(), cols = from.at(1).get<Eigen::Index>();
    const Json::binary_t& data = from.at(2).get_binary();
    const std::size_t size = sizeof(*value.data());
    const auto fits = [](int fixed, Eigen::Index count) { return fixed == Eigen::Dynamic || fixed == count; };
    const bool right_shape =
        rows >= 0 && cols >= 0 && fits(T::RowsAtCompileTime, rows) && fits(T::ColsAtCompileTime, cols);
    if (!right_shape || data.size() != size * static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols))
      throw std::runtime_error("a matrix has not the size that it states");
    value.resize(rows, cols);
    if (!data.empty()) std::memcpy(value.data(), data.data(), data.size());
  }
};

}  // namespace archive

/// Archive of a value. `format`: name and version of what is kept.
template <class T>
std::vector<std::uint8_t> to_bytes(const std::string& format, const T& value) {
  return archive::Json::to_cbor({{"format", format}, {"state", archive::Writer::one(value)}});
}

/// Restores a value. Throws std::exception: the bytes are of another format, or damaged.
template <class T, class Bytes>
void from_bytes(const std::string& format, const Bytes& bytes, T& value) {
  const archive::Json json = archive::Json::from_cbor(bytes);
  if (json.at("format") != format) throw std::runtime_error("it is of another kind");
  archive::Reader::one(json.at("state"), value);
}

}  // namespace dimple

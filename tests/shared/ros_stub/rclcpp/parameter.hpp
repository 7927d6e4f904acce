// A stand-in for rclcpp::Parameter: a value of the types that parameters of a solver have.
#pragma once

#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace rclcpp
{
class Parameter
{
  using Value = std::variant<double, std::string, std::vector<double>, std::vector<std::string>>;
  Value value_;

public:
  Parameter() = default;
  explicit Parameter(Value value) : value_(std::move(value)) {}
  double as_double() const { return std::get<double>(value_); }
  std::string as_string() const { return std::get<std::string>(value_); }
  std::vector<double> as_double_array() const { return std::get<std::vector<double>>(value_); }
  std::vector<std::string> as_string_array() const { return std::get<std::vector<std::string>>(value_); }
};
}  // namespace rclcpp

// A stand-in for the exceptions of rclcpp that a solver throws.
#pragma once

#include <stdexcept>

namespace rclcpp::exceptions
{
struct InvalidParameterValueException : std::runtime_error { using std::runtime_error::runtime_error; };
struct ParameterUninitializedException : std::runtime_error { using std::runtime_error::runtime_error; };
}  // namespace rclcpp::exceptions

// Exceptions of inverse_dynamics_solver, by their names.
#pragma once

#include <rclcpp/exceptions/exceptions.hpp>
#include <stdexcept>

namespace inverse_dynamics_solver
{
using InvalidParameterValueException = rclcpp::exceptions::InvalidParameterValueException;
using ParameterUninitializedException = rclcpp::exceptions::ParameterUninitializedException;

struct UninitializedException : std::runtime_error
{
  UninitializedException() : std::runtime_error("the solver is not initialized") {}
};
}  // namespace inverse_dynamics_solver

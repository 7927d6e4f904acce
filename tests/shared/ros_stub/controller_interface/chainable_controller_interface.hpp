// A stand-in for controller_interface of Humble, with handles of hardware and a node that knows its name.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace rclcpp
{
class Time {};

class Duration
{
  double seconds_;

public:
  explicit Duration(double seconds) : seconds_(seconds) {}
  double seconds() const { return seconds_; }
};
}  // namespace rclcpp

namespace rclcpp_lifecycle
{
class State {};

struct LifecycleNode { const char* get_name() const { return "feed_forward"; } };
}  // namespace rclcpp_lifecycle

namespace hardware_interface
{
// Of a command or a state: its name, and where its value is.
class CommandInterface
{
  std::string prefix_, name_;
  double* value_;

public:
  CommandInterface(const std::string& prefix, const std::string& name, double* value) : prefix_(prefix), name_(name), value_(value) {}
  CommandInterface(const CommandInterface&) = delete;
  CommandInterface(CommandInterface&&) = default;
  std::string get_full_name() const { return prefix_ + "/" + name_; }
  double get_value() const { return *value_; }
  void set_value(double value) { *value_ = value; }
};
}  // namespace hardware_interface

namespace controller_interface
{
enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };
enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };

struct InterfaceConfiguration
{
  interface_configuration_type type;
  std::vector<std::string> names = {};
};

class ChainableControllerInterface
{
public:
  virtual ~ChainableControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State&) = 0;
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State&) = 0;
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return std::make_shared<rclcpp_lifecycle::LifecycleNode>(); }

  // What the controller manager does, here a program of the tests.
  std::vector<hardware_interface::CommandInterface> export_references() { return on_export_reference_interfaces(); }

  return_type update(double period)
  {
    const return_type first = update_reference_from_subscribers();
    return first == return_type::OK ? update_and_write_commands(rclcpp::Time(), rclcpp::Duration(period)) : first;
  }

  std::vector<hardware_interface::CommandInterface> command_interfaces_, state_interfaces_;

protected:
  virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() = 0;
  virtual return_type update_reference_from_subscribers() = 0;
  virtual return_type update_and_write_commands(const rclcpp::Time&, const rclcpp::Duration&) = 0;
  std::vector<double> reference_interfaces_;
};
}  // namespace controller_interface

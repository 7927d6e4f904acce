// A stand-in for rclcpp's interface to the parameters of a node.
#pragma once

#include <map>
#include <memory>
#include <rclcpp/parameter.hpp>
#include <string>

namespace rclcpp::node_interfaces
{
class NodeParametersInterface
{
public:
  using ConstSharedPtr = std::shared_ptr<const NodeParametersInterface>;
  std::map<std::string, Parameter> values;

  bool has_parameter(const std::string& name) const { return values.count(name) != 0; }

  bool get_parameter(const std::string& name, Parameter& out) const
  {
    const auto found = values.find(name);
    if (found == values.end()) return false;
    out = found->second;
    return true;
  }
};
}  // namespace rclcpp::node_interfaces

// The interface of inverse_dynamics_solver: its virtual functions by name and type, written anew.
#pragma once

#include <eigen3/Eigen/Core>
#include <rclcpp/node_interfaces/node_parameters_interface.hpp>
#include <string>
#include <tuple>

namespace inverse_dynamics_solver
{
class InverseDynamicsSolver
{
protected:
  using Vector = Eigen::VectorXd;
  using Matrix = Eigen::MatrixXd;
  InverseDynamicsSolver() = default;

public:
  virtual ~InverseDynamicsSolver() = default;
  virtual void initialize(rclcpp::node_interfaces::NodeParametersInterface::ConstSharedPtr parameters = nullptr,
                          const std::string& name_space = "", const std::string& robot_description = "") = 0;
  virtual Matrix getInertiaMatrix(const Vector& q) const = 0;
  virtual Vector getCoriolisVector(const Vector& q, const Vector& qd) const = 0;
  virtual Vector getGravityVector(const Vector& q) const = 0;
  virtual Vector getFrictionVector(const Vector& qd) const = 0;

  virtual std::tuple<Matrix, Vector, Vector> getDynamicParameters(const Vector& q, const Vector& qd) const
  {
    return {getInertiaMatrix(q), getCoriolisVector(q, qd), getGravityVector(q)};
  }

  virtual Vector getTorques(const Vector& q, const Vector& qd, const Vector& qdd) const
  {
    const auto [mass, coriolis, gravity] = getDynamicParameters(q, qd);
    return mass * qdd + coriolis + gravity;
  }
};
}  // namespace inverse_dynamics_solver

// Loads the plugin of a package of `flexinv export-ros` by pluginlib, and writes what its functions give for one sample.
//   replay PLUGIN N q... qd... qdd...      rows of numbers: torques, gravity, Coriolis, friction, the inertia matrix
//   replay PLUGIN refuse                   what the solver says to parameters and vectors that cannot be

#include <cstdio>
#include <cstdlib>
#include <functional>
#include <inverse_dynamics_solver/exceptions.hpp>
#include <inverse_dynamics_solver/inverse_dynamics_solver.hpp>
#include <pluginlib/class_loader.hpp>

using Interface = inverse_dynamics_solver::InverseDynamicsSolver;
using Parameters = rclcpp::node_interfaces::NodeParametersInterface;

static void write(const Eigen::MatrixXd& numbers)
{
  for (Eigen::Index i = 0; i < numbers.size(); ++i) std::printf("%.17g ", numbers(i));
  std::printf("\n");
}

static std::shared_ptr<Parameters> give(const std::string& name, const rclcpp::Parameter& value)
{
  auto out = std::make_shared<Parameters>();
  out->values[name] = value;
  return out;
}

static void refused(const std::function<void()>& call)
{
  try {
    call();
    std::printf("accepted\n");
  } catch (const std::exception& error) {
    std::printf("%s\n", error.what());
  }
}

static int refuse(Interface& solver)
{
  const Eigen::VectorXd two = Eigen::VectorXd::Zero(2);
  refused([&] { solver.getGravityVector(two); });
  refused([&] { solver.initialize(give("x.joints", rclcpp::Parameter(std::vector<std::string>{"nobody"})), "x"); });
  refused([&] { solver.initialize(give("gravity", rclcpp::Parameter(std::vector<double>{1.0}))); });
  refused([&] { solver.initialize(give("payload.link", rclcpp::Parameter(std::string("nobody")))); });
  solver.initialize();
  refused([&] { solver.getGravityVector(two); });
  refused([&] { solver.getGravityVector(Eigen::VectorXd::Constant(3, NAN)); });
  return 0;
}

int main(int count, char** words)
{
  pluginlib::ClassLoader<Interface> loader("inverse_dynamics_solver", "inverse_dynamics_solver::InverseDynamicsSolver");
  auto solver = loader.createUniqueInstance(words[1]);
  if (count == 3) return refuse(*solver);
  const Eigen::Index n = std::atoi(words[2]);
  Eigen::VectorXd all(3 * n);
  for (Eigen::Index i = 0; i < 3 * n; ++i) all[i] = std::atof(words[3 + i]);
  const Eigen::VectorXd q = all.head(n), qd = all.segment(n, n), qdd = all.tail(n);
  auto parameters = give("solver.gravity", rclcpp::Parameter(std::vector<double>{1.0, -2.0, -9.0}));
  parameters->values["solver.joints"] = rclcpp::Parameter(std::vector<std::string>{"joint3", "joint1", "joint2"});
  parameters->values["solver.payload.link"] = rclcpp::Parameter(std::string("link3"));
  parameters->values["solver.payload.mass"] = rclcpp::Parameter(0.5);
  parameters->values["solver.payload.centre"] = rclcpp::Parameter(std::vector<double>{0.02, -0.01, 0.05});
  solver->initialize(parameters, "solver");
  write(solver->getTorques(q, qd, qdd));
  write(solver->getGravityVector(q));
  write(solver->getCoriolisVector(q, qd));
  write(solver->getFrictionVector(qd));
  write(solver->getInertiaMatrix(q));
  write(std::get<2>(solver->getDynamicParameters(q, qd)));
  return 0;
}

// Efforts of single samples of a rigid robot: an exported library and pinocchio::rnea, in turn, in one process.
//
//     timed LIBRARY NAME ROBOT MOTION ROUNDS CALLS LAYOUT
//
// LIBRARY is a shared library whose functions begin with NAME; ROBOT describes Pinocchio's model in numbers, as speed.py writes
// it; MOTION holds rows of q, qd, qdd in the order of both.  Prints the largest difference over the largest effort, and the
// medians of the rounds: nanoseconds of one call of the library, and of pinocchio::rnea.

#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody.hpp>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <dlfcn.h>
#include <fstream>
#include <string>
#include <vector>

struct Row { Eigen::VectorXd q, qd, qdd; };

using Start = int (*)(void *, std::size_t, int);
using Size = std::size_t (*)();
using Torque = int (*)(void *, const double *, const double *, const double *, double *);

static pinocchio::JointModel make_joint(const std::string &kind, const Eigen::Vector3d &axis)
{
    if (kind == "JointModelRX") return pinocchio::JointModelRX();
    if (kind == "JointModelRY") return pinocchio::JointModelRY();
    if (kind == "JointModelRZ") return pinocchio::JointModelRZ();
    if (kind == "JointModelPX") return pinocchio::JointModelPX();
    if (kind == "JointModelPY") return pinocchio::JointModelPY();
    if (kind == "JointModelPZ") return pinocchio::JointModelPZ();
    if (kind == "JointModelRUBX") return pinocchio::JointModelRUBX();
    if (kind == "JointModelRUBY") return pinocchio::JointModelRUBY();
    if (kind == "JointModelRUBZ") return pinocchio::JointModelRUBZ();
    if (kind == "JointModelRevoluteUnaligned") return pinocchio::JointModelRevoluteUnaligned(axis);
    if (kind == "JointModelPrismaticUnaligned") return pinocchio::JointModelPrismaticUnaligned(axis);
    std::fprintf(stderr, "no joint %s\n", kind.c_str());
    std::exit(3);
}

// Joints: kind, parent, axis, placement (rotation by rows, translation) and what is fixed to them, m, m c and inertia.
static pinocchio::Model read_model(const char *path)
{
    pinocchio::Model model;
    std::ifstream file(path);
    std::string kind;
    for (int k = 1; file >> kind; ++k) {
        std::size_t parent;
        Eigen::Vector3d axis;
        pinocchio::SE3 placement;
        Eigen::Matrix<double, 10, 1> numbers;
        file >> parent;
        for (int i = 0; i < 3; ++i) file >> axis[i];
        for (int i = 0; i < 9; ++i) file >> placement.rotation()(i / 3, i % 3);
        for (int i = 0; i < 3; ++i) file >> placement.translation()[i];
        for (int i = 0; i < 10; ++i) file >> numbers[i];
        const auto joint = model.addJoint(parent, make_joint(kind, axis), placement, "joint" + std::to_string(k));
        if (numbers[0] > 0.0) model.appendBodyToJoint(joint, pinocchio::Inertia::FromDynamicParameters(numbers));
    }
    return model;
}

template <class Call> static double time_calls(const std::vector<Row> &rows, long calls, Call call)
{
    const auto start = std::chrono::steady_clock::now();
    for (long k = 0; k < calls; ++k) call(rows[static_cast<std::size_t>(k) % rows.size()]);
    return std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - start).count() / static_cast<double>(calls);
}

static double median(std::vector<double> values)
{
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

template <class Function> static Function find(void *library, const std::string &name)
{
    void *found = dlsym(library, name.c_str());
    if (found == nullptr) std::exit(3);
    return reinterpret_cast<Function>(found);
}

int main(int argc, char **argv)
{
    if (argc != 8) return 3;
    void *library = dlopen(argv[1], RTLD_NOW);
    if (library == nullptr) return 3;
    const std::string name = argv[2];
    const auto torque = find<Torque>(library, name + "_torque");
    const std::size_t size = find<Size>(library, name + "_size")();
    void *block = std::aligned_alloc(64, size);
    if (find<Start>(library, name + "_start")(block, size, std::atoi(argv[7])) != 0) return 3;
    const pinocchio::Model model = read_model(argv[3]);
    pinocchio::Data data(model);
    std::vector<Row> rows;
    std::ifstream file(argv[4], std::ios::binary);
    for (Row row{Eigen::VectorXd(model.nq), Eigen::VectorXd(model.nv), Eigen::VectorXd(model.nv)};;) {
        for (auto *part : {&row.q, &row.qd, &row.qdd})
            file.read(reinterpret_cast<char *>(part->data()), static_cast<std::streamsize>(part->size() * sizeof(double)));
        if (!file) break;
        rows.push_back(row);
    }
    if (rows.empty()) return 3;
    Eigen::VectorXd tau(model.nv);
    double apart = 0.0, largest = 0.0, sum = 0.0;
    for (const Row &row : rows) {
        if (torque(block, row.q.data(), row.qd.data(), row.qdd.data(), tau.data()) != 0) return 3;
        pinocchio::rnea(model, data, row.q, row.qd, row.qdd);
        apart = std::max(apart, (tau - data.tau).cwiseAbs().maxCoeff());
        largest = std::max(largest, tau.cwiseAbs().maxCoeff());
    }
    std::vector<double> ours, theirs;
    for (int round = 0; round < std::atoi(argv[5]); ++round) {
        ours.push_back(time_calls(rows, std::atol(argv[6]), [&](const Row &row) {
            torque(block, row.q.data(), row.qd.data(), row.qdd.data(), tau.data());
            sum += tau[0];
        }));
        theirs.push_back(time_calls(rows, std::atol(argv[6]), [&](const Row &row) {
            sum += pinocchio::rnea(model, data, row.q, row.qd, row.qdd)[0];
        }));
    }
    std::printf("%.3e %.1f %.1f\n", apart / largest, median(ours), median(theirs));
    std::free(block);
    return sum == sum ? 0 : 1;
}

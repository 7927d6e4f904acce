// Simbody as an engine of crosscheck: reads a case kit, writes an answer.      answer KIT OUT
//
// Efforts: calcResidualForceIgnoringConstraints gives M udot + bias - f, where f are Simbody's own force elements (gravity,
// springs, dampers).  Closures are Simbody's own constraints; its G projects the efforts onto the motions they allow, and the
// drives share them so that the sum of weight tau^2 is least.  Simbody has no rotors and no dry friction: added outside.
// Coordinates: u of Simbody = B u of the kit, tau of the kit = B^T tau of Simbody.  B is a permutation, but for spherical and
// free joints, whose rates Simbody has along the axes of the joint frame and the kit along those of the child.
#include <Simbody.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <stdexcept>

// Not all of SimTK: it has an operator!= for everything, nlohmann's iterators among it.
using SimTK::Array_, SimTK::Body, SimTK::Constraint, SimTK::CoordinateAxis, SimTK::FactorSVD, SimTK::Force, SimTK::Function;
using SimTK::GeneralForceSubsystem, SimTK::Inertia, SimTK::MassProperties, SimTK::Mat33, SimTK::Matrix, SimTK::MobilizedBody;
using SimTK::MobilizedBodyIndex, SimTK::MobilizerQIndex, SimTK::MobilizerUIndex, SimTK::MultibodySystem, SimTK::Pi;
using SimTK::Rotation, SimTK::SimbodyMatterSubsystem, SimTK::SpatialVec, SimTK::Stage, SimTK::State, SimTK::Transform;
using SimTK::UnitVec3, SimTK::Vec3, SimTK::Vector, SimTK::Vector_, SimTK::XAxis, SimTK::ZAxis;
using json = nlohmann::json;

struct Refused : std::runtime_error { using std::runtime_error::runtime_error; };

const double RANK = 1e-10;     // of the largest singular value: below, equations are dependent
const double CLOSED = 1e-13;   // [m], [-]: Newton's method ends where closures hold to this
const double CARRIED = 1e-8;   // of the efforts: what is left over where drives cannot make the motion

Vec3 vec(const json& a) { return Vec3(a[0], a[1], a[2]); }

Transform transform(const json& frame) {
    Mat33 rows;
    for (int i = 0; i < 3; ++i) for (int j = 0; j < 3; ++j) rows(i, j) = frame["rotation"][i][j];
    Rotation turned;
    return Transform(turned.setRotationFromMat33TrustMe(rows), vec(frame["position"]));
}

Vector least(const Matrix& a, const Vector& b) {  // a x = b: least squares, of all solutions the shortest
    Vector x(a.ncol(), 0.0);
    if (a.nrow() && a.ncol() && a.norm() > 0) FactorSVD(a, RANK).solve(b, x);
    return x;
}

struct Table {  // a CSV file: "q/NAME [unit]" is a column
    std::map<std::string, int> column;
    std::vector<std::vector<double>> rows;
    explicit Table(const std::string& path) {
        std::ifstream file(path);
        std::string line, cell;
        std::getline(file, line);
        std::stringstream head(line);
        for (int k = 0; std::getline(head, cell, ','); ++k) column[cell.substr(0, cell.find(" ["))] = k;
        while (std::getline(file, line)) {
            std::stringstream cells(line);
            rows.emplace_back();
            while (std::getline(cells, cell, ',')) rows.back().push_back(std::stod(cell));
        }
    }
    double at(int row, const std::string& name, double otherwise = 0.0) const {
        auto found = column.find(name);
        return found == column.end() ? otherwise : rows[row][found->second];
    }
};

struct Moving {  // a joint with a freedom: its bodies in Simbody, and its first velocity in the kit
    json data;
    std::vector<MobilizedBody> bodies;
    int first;
    double turned = 0.0;  // [rad]: a continuous joint is followed over whole turns
    std::string name() const { return data["name"]; }
};

class Model {
public:
    explicit Model(const json& file) : kit(file), matter(system), forces(system), gravity(forces, matter,
                                           vec(file["mechanism"]["gravity"])) {
        const json& mechanism = kit["mechanism"];
        links["world"] = matter.updGround();
        for (const json& link : mechanism["links"]) {
            if (!link["beam"].is_null()) throw Refused("Simbody has rigid bodies only here: " + link["name"].get<std::string>());
            weights[link["name"]] = weight(link["bodies"]);
        }
        for (const json& joint : mechanism["joints"]) add(joint);
        for (const json& closure : mechanism["closures"]) close(closure);
        for (const json& spring : mechanism["springs"]) pull(spring);
        state = system.realizeTopology();
        system.realizeModel(state);
        for (const json& v : kit["case"]["velocities"]) { given.push_back(v["given"]); driven.push_back(v["actuated"]); }
        nv = int(given.size());
    }

    void place(const Table& table, int row, bool rates) {  // the state of a row of motion.csv or probe.csv
        state.setTime(table.at(row, "time"));
        Vector& q = state.updQ();
        for (Moving& m : joints) {
            const std::string kind = m.data["kind"];
            int at = m.bodies[0].getFirstQIndex(state);
            if (!table.column.count("q/" + m.data["q"][0].get<std::string>())) { if (row == 0 && rates) guess(m, q); continue; }
            std::vector<double> x;
            for (const json& name : m.data["q"]) x.push_back(table.at(row, "q/" + name.get<std::string>()));
            if (kind == "continuous") {
                double angle = std::atan2(x[1], x[0]);
                q[at] = m.turned = angle + 2 * Pi * std::round((m.turned - angle) / (2 * Pi));
            } else if (kind == "spherical" || kind == "free") {
                int k = kind == "free" ? 3 : 0;  // the kit has x, y, z, w; Simbody w, x, y, z, and the position behind
                q[at] = x[k + 3];
                for (int i = 0; i < 3; ++i) { q[at + 1 + i] = x[k + i]; if (k) q[at + 4 + i] = x[i]; }
            } else {
                for (size_t i = 0; i < x.size(); ++i) q[int(m.bodies[i].getFirstQIndex(state))] = x[i];
            }
        }
        system.realize(state, Stage::Position);
        Vector u(nv, 0.0), a(nv, 0.0);
        for (int k = 0; k < nv && rates; ++k) {
            const std::string name = kit["case"]["velocities"][k]["name"];
            u[k] = table.at(row, "qd/" + name);
            a[k] = table.at(row, "qdd/" + name);
        }
        if (rates && hasClosures()) find(u, a);
        rate = u; acceleration = a;
        Matrix b = basis();
        state.updU() = b * u;
        udot = b * a + turning(u);
        system.realize(state, Stage::Dynamics);
    }

    Vector efforts() {  // of the kit's velocities [N m], [N]
        Vector_<SpatialVec> body = system.getRigidBodyForces(state, Stage::Dynamics);
        Vector found(nv);
        for (const json& force : kit["mechanism"]["forces"]) push(force, body);
        for (const json& spring : kit["mechanism"]["springs"]) if (!spring["law"].is_null()) blow(spring, body);
        matter.calcResidualForceIgnoringConstraints(state, system.getMobilityForces(state, Stage::Dynamics), body, udot, found);
        Vector tau = ~basis() * found;
        for (const Moving& m : joints)
            for (int k = m.first; k < m.first + int(m.data["v"].size()); ++k) {
                double sign = (rate[k] > 0) - (rate[k] < 0);
                tau[k] += rotors[k] * acceleration[k] + double(m.data["friction"]) * sign;
            }
        return hasClosures() ? shared(tau) : tau;
    }

    json certificate(const Table& probe) {
        json out, matrices = json::array(), weighed = json::array(), centres = json::array(), order = json::array();
        json axes = json::object(), masses = json::object(), moments = json::object(), inertias = json::object();
        double total = 0;
        std::map<int, const Moving*> carrier;  // the moving joint that carries a body, by the body's index; welds pass it on
        std::map<const Moving*, Vec3> moment;
        std::map<const Moving*, Inertia> inertia;
        place(probe, 0, false);
        for (const Moving& m : joints) {
            order.push_back(m.data["name"]);
            for (const MobilizedBody& b : m.bodies) carrier[b.getMobilizedBodyIndex()] = &m;
        }
        for (MobilizedBodyIndex k(1); k < matter.getNumBodies(); ++k) {
            const MobilizedBody& b = matter.getMobilizedBody(k);
            auto parent = carrier.find(b.getParentMobilizedBody().getMobilizedBodyIndex());
            if (!carrier.count(k) && parent != carrier.end()) carrier[k] = parent->second;
            if (!carrier.count(k)) continue;  // welded to the world
            const Moving* by = carrier[k];
            const MassProperties own = b.getBodyMassProperties(state).calcTransformedMassProps(
                b.findBodyTransformInAnotherBody(state, by->bodies.back()).invert());
            total += own.getMass();
            masses[by->name()] = masses.value(by->name(), 0.0) + own.getMass();
            moment[by] = (moment.count(by) ? moment[by] : Vec3(0)) + own.getMass() * own.getMassCenter();
            inertia[by] = (inertia.count(by) ? inertia[by] : Inertia(0)) + own.getInertia();
        }
        for (const Moving& m : joints) {
            const Mat33 i = inertia[&m].toMat33();
            moments[m.name()] = {moment[&m][0], moment[&m][1], moment[&m][2]};
            for (int k = 0; k < 3; ++k) inertias[m.name()].push_back({i(k, 0), i(k, 1), i(k, 2)});
        }
        for (int row = 0; row < int(probe.rows.size()); ++row) {
            place(probe, row, false);
            Matrix b = basis(), m;
            matter.calcM(state, m);
            m = ~b * m * b;
            for (int k = 0; k < nv; ++k) m(k, k) += rotors[k];
            Vector none(nv, 0.0), held(nv);
            matter.calcResidualForceIgnoringConstraints(state, none, gravity.getBodyForces(state), none, held);
            held = ~b * held;
            matrices.push_back(json::array());
            for (int i = 0; i < nv; ++i) { matrices.back().push_back(json::array()); for (int j = 0; j < nv; ++j) matrices.back()[i].push_back(m(i, j)); }
            weighed.push_back(std::vector<double>(&held[0], &held[0] + nv));
            Vec3 centre(0);
            for (const auto& one : carrier) {
                const MobilizedBody& at = matter.getMobilizedBody(MobilizedBodyIndex(one.first));
                centre += at.getBodyMass(state) * at.findMassCenterLocationInGround(state) / (total > 0 ? total : 1.0);
            }
            centres.push_back({centre[0], centre[1], centre[2]});
            for (const Moving& j : joints) {
                if (j.data["v"].size() != 1) continue;
                bool slides = j.data["kind"] == "prismatic";
                UnitVec3 w = j.bodies[0].getBodyRotation(state) * j.bodies[0].getOutboardFrame(state).R().getAxisUnitVec(slides ? CoordinateAxis(XAxis) : CoordinateAxis(ZAxis));
                axes[j.data["name"].get<std::string>()].push_back({w[0], w[1], w[2]});
            }
        }
        out = {{"mass", total}, {"masses", masses}, {"moments", moments}, {"inertias", inertias},
               {"mass_matrix", matrices}, {"gravity", weighed}, {"com", centres}, {"order", order}, {"axes", axes}};
        return out;
    }

    Vec3 tip(const json& link) { return links.at(link["name"]).findStationLocationInGround(state, vec(link["tip"])); }
    int velocities() const { return nv; }

private:
    json kit;
    MultibodySystem system;
    SimbodyMatterSubsystem matter;
    GeneralForceSubsystem forces;
    Force::Gravity gravity;
    State state;
    std::map<std::string, MobilizedBody> links;
    std::map<std::string, MassProperties> weights;
    std::vector<Moving> joints;
    std::vector<bool> given, driven;
    std::vector<double> share, rotors;  // of the kit's velocities
    int nv = 0;
    Vector rate, acceleration, udot;

    static MassProperties weight(const json& bodies) {  // about the link's origin [kg, m, kg m^2]
        double mass = 0;
        Vec3 moment(0);
        Inertia inertia(0);
        for (const json& body : bodies) {
            const double m = body["mass"];
            const Vec3 c = vec(body["com"]);
            const json& i = body["inertia"];
            inertia += Inertia(Vec3(i[0][0], i[1][1], i[2][2]), Vec3(i[0][1], i[0][2], i[1][2])).shiftFromMassCenter(c, m);
            mass += m;
            moment += m * c;
        }
        return MassProperties(mass, mass > 0 ? Vec3(moment / mass) : Vec3(0), inertia);
    }

    void add(const json& joint) {
        const std::string kind = joint["kind"], name = joint["name"];
        MobilizedBody& parent = links.at(joint["parent"]);
        const Transform frame = transform(joint["frame"]), here;
        const Body::Rigid body(weights.at(joint["child"]));
        auto along = [&](const char* which, CoordinateAxis axis) { return Transform(Rotation(UnitVec3(vec(joint[which])), axis)); };
        Moving m{joint, {}, nv};
        if (kind == "fixed") {
            links[joint["child"]] = MobilizedBody::Weld(parent, frame, body, here);
            return;
        }
        const Transform z = along("axis", ZAxis), x = along("axis", XAxis);
        if (kind == "revolute" || kind == "continuous") m.bodies = {MobilizedBody::Pin(parent, frame * z, body, z)};
        else if (kind == "prismatic") m.bodies = {MobilizedBody::Slider(parent, frame * x, body, x)};
        else if (kind == "helical") m.bodies = {MobilizedBody::Screw(parent, frame * z, body, z, double(joint["pitch"]) / (2 * Pi))};
        else if (kind == "spherical") m.bodies = {MobilizedBody::Ball(parent, frame, body, here)};
        else if (kind == "free") m.bodies = {MobilizedBody::Free(parent, frame, body, here)};
        else if (kind == "universal") {
            const Transform second = along("second_axis", ZAxis);
            m.bodies = {MobilizedBody::Pin(parent, frame * z, Body::Massless(), z)};
            m.bodies.push_back(MobilizedBody::Pin(m.bodies[0], second, body, second));
        } else throw Refused("this program has no " + kind + " joints: " + name);
        const double damping = joint["damping"], stiffness = joint["stiffness"];
        if (joint["v"].size() != m.bodies.size() && (damping != 0 || stiffness != 0))
            throw Refused("this program has no springs and dampers in joints with several velocities: " + name);
        for (const MobilizedBody& b : m.bodies) {
            if (damping != 0) Force::MobilityLinearDamper(forces, b, MobilizerUIndex(0), damping);
            if (stiffness != 0) Force::MobilityLinearSpring(forces, b, MobilizerQIndex(0), stiffness, joint["rest"]);
        }
        nv += int(joint["v"].size());
        share.resize(nv, joint["weight"]);
        rotors.resize(nv, joint["rotor_inertia"]);
        links[joint["child"]] = m.bodies.back();
        joints.push_back(m);
    }

    void close(const json& c) {
        const std::string kind = c["kind"], name = c["name"];
        if (!c["active"].empty() || c["capture"].get<bool>()) throw Refused("closures that act for a while are not in this program: " + name);
        if (kind == "coupling") {
            Array_<MobilizedBodyIndex> bodies;
            Vector factors(0);
            for (const Moving& m : joints)
                if (c["factors"].contains(m.data["name"])) {
                    bodies.push_back(m.bodies[0].getMobilizedBodyIndex());
                    factors.resizeKeep(int(bodies.size()));
                    factors[int(bodies.size()) - 1] = c["factors"][m.data["name"].get<std::string>()];
                }
            factors.resizeKeep(factors.size() + 1);
            factors[factors.size() - 1] = -double(c["offset"]);
            Constraint::CoordinateCoupler(matter, new Function::Linear(factors), bodies, Array_<MobilizerQIndex>(bodies.size(), MobilizerQIndex(0)));
            return;
        }
        MobilizedBody &one = links.at(c["first"]["link"]), &two = links.at(c["second"]["link"]);
        const Transform a = transform(c["first"]["frame"]), b = transform(c["second"]["frame"]);
        const UnitVec3 axis(vec(c["axis"])), free = a.R() * axis;
        if (kind == "fixed" || kind == "prismatic") Constraint::ConstantOrientation(one, a.R(), two, b.R());
        if (kind == "point-on-line" || kind == "prismatic" || kind == "cylindrical") Constraint::PointOnLine(one, free, a.p(), two, b.p());
        else Constraint::Ball(one, a.p(), two, b.p());
        if (kind == "revolute" || kind == "cylindrical") {
            const UnitVec3 u = axis.perp(), w(axis % u);
            Constraint::ConstantAngle(one, a.R() * u, two, b.R() * axis);
            Constraint::ConstantAngle(one, a.R() * w, two, b.R() * axis);
        }
        if (kind == "universal") Constraint::ConstantAngle(one, free, two, b.R() * UnitVec3(vec(c["second_axis"])));
    }

    void pull(const json& s) {
        const bool gas = !s["law"].is_null();  // its force is added outside: see blow
        if (gas && s["law"]["kind"] != "gas") throw Refused("springs with a table are not in this program: " + s["name"].get<std::string>());
        MobilizedBody &one = links.at(s["first"]["link"]), &two = links.at(s["second"]["link"]);
        const Vec3 p = vec(s["first"]["frame"]["position"]), r = vec(s["second"]["frame"]["position"]);
        if (!gas) Force::TwoPointLinearSpring(forces, one, p, two, r, s["stiffness"], s["rest"]);
        Force::TwoPointLinearDamper(forces, one, p, two, r, s["damping"]);
    }

    void blow(const json& s, Vector_<SpatialVec>& body) const {  // pull force / (1 - (l - rest) / travel)^exponent
        const MobilizedBody &one = links.at(s["first"]["link"]), &two = links.at(s["second"]["link"]);
        const Vec3 p = vec(s["first"]["frame"]["position"]), r = vec(s["second"]["frame"]["position"]);
        const Vec3 line = two.findStationLocationInGround(state, r) - one.findStationLocationInGround(state, p);
        const double left = 1.0 - (line.norm() - double(s["rest"])) / double(s["law"]["travel"]);
        const Vec3 pull = double(s["law"]["force"]) * std::pow(left, -double(s["law"]["exponent"])) * line / line.norm();
        one.applyForceToBodyPoint(state, p, pull, body);
        two.applyForceToBodyPoint(state, r, -pull, body);
    }

    void push(const json& force, Vector_<SpatialVec>& body) const {  // linear between its times
        const std::vector<double> times = force["time"];
        size_t k = std::upper_bound(times.begin(), times.end(), state.getTime()) - times.begin();
        size_t before = k ? k - 1 : 0, after = std::min(k, times.size() - 1);
        double part = after > before ? (state.getTime() - times[before]) / (times[after] - times[before]) : 0.0;
        Vec3 half[2];
        for (int i = 0; i < 6; ++i)
            half[i / 3][i % 3] = (1 - part) * double(force["wrench"][before][i]) + part * double(force["wrench"][after][i]);
        const MobilizedBody& at = links.at(force["at"]["link"]);
        const Transform own = transform(force["at"]["frame"]);
        const Rotation turned = force["follower"].get<bool>() ? at.getBodyRotation(state) * own.R() : Rotation();
        at.applyForceToBodyPoint(state, own.p(), turned * half[0], body);
        at.applyBodyTorque(state, turned * half[1], body);
    }

    Matrix basis() const {  // B: (u of Simbody, u of the kit), at the state's position
        Matrix b(nv, nv, 0.0);
        for (const Moving& m : joints) {
            const std::string kind = m.data["kind"];
            const int at = m.bodies[0].getFirstUIndex(state);
            if (kind == "spherical" || kind == "free") {
                const Mat33 r = m.bodies[0].getMobilizerTransform(state).R().asMat33();
                const int k = kind == "free" ? 3 : 0;  // the kit has the linear part first
                for (int i = 0; i < 3; ++i)
                    for (int j = 0; j < 3; ++j) { b(at + i, m.first + k + j) = r(i, j); if (k) b(at + 3 + i, m.first + j) = r(i, j); }
            } else for (size_t i = 0; i < m.bodies.size(); ++i) b(int(m.bodies[i].getFirstUIndex(state)), m.first + int(i)) = 1.0;
        }
        return b;
    }

    Vector turning(const Vector& u) const {  // dB/dt u: a free joint's velocity turns with its child
        Vector out(nv, 0.0);
        for (const Moving& m : joints) {
            if (m.data["kind"] != "free") continue;
            const Rotation r = m.bodies[0].getMobilizerTransform(state).R();
            const Vec3 v(u[m.first], u[m.first + 1], u[m.first + 2]), w(u[m.first + 3], u[m.first + 4], u[m.first + 5]);
            const Vec3 d = r * (w % v);
            for (int i = 0; i < 3; ++i) out[int(m.bodies[0].getFirstUIndex(state)) + 3 + i] = d[i];
        }
        return out;
    }

    bool hasClosures() const { return matter.getNumConstraints() > 0; }

    void guess(const Moving& m, Vector& q) const {
        const json& start = kit["case"]["start"];
        const std::string name = m.data["name"], kind = m.data["kind"];
        if (!start.contains(name)) return;
        if (kind == "spherical" || kind == "free") throw Refused("this program takes no start of joints of several coordinates: " + name);
        for (size_t i = 0; i < m.bodies.size(); ++i) q[int(m.bodies[i].getFirstQIndex(state))] = start[name][i];
    }

    Matrix columns(const Matrix& a, bool which) const {
        Matrix out(a.nrow(), int(std::count(given.begin(), given.end(), which)));
        for (int k = 0, n = 0; k < nv; ++k) if (given[k] == which) out(n++) = a(k);
        return out;
    }

    void spread(const Vector& part, Vector& whole) const { for (int k = 0, n = 0; k < nv; ++k) if (!given[k]) whole[k] = part[n++]; }

    Matrix jacobian() const { Matrix g; matter.calcG(state, g); return g * basis(); }

    void find(Vector& u, Vector& a) {  // joints without a motion: Newton's method, then rates and accelerations
        bool holds = false;
        for (int k = 0;; ++k) {
            const Matrix g = jacobian();
            const Vector off = state.getQErr()(0, g.nrow());
            if (holds || k == 50) {
                if (off.normInf() > 1e-9) throw std::runtime_error("closures do not close at t = " + std::to_string(state.getTime()));
                break;
            }
            holds = off.normInf() < CLOSED;  // and once more: links of some centimetres feel 1e-13 m
            Vector step(nv, 0.0), moved;
            spread(least(columns(g, false), -1.0 * off), step);
            matter.multiplyByN(state, false, basis() * step, moved);
            state.updQ() += moved;
            system.realize(state, Stage::Time);
            matter.normalizeQuaternions(state);
            system.realize(state, Stage::Position);
        }
        const Matrix g = jacobian();
        spread(least(columns(g, false), -1.0 * (g * u)), u);
        state.updU() = basis() * u;
        system.realize(state, Stage::Velocity);
        Vector bias;
        matter.calcBiasForAccelerationConstraints(state, bias);
        Matrix own;
        matter.calcG(state, own);
        spread(least(columns(g, false), -1.0 * (g * a + own * turning(u) + bias)), a);
    }

    Vector shared(const Vector& tau) const {  // tau = S x + G^T lambda: x of the drives, sum weight x^2 least
        const Matrix g = jacobian(), back = ~g;
        auto allowed = [&](const Vector& x) { return Vector(x - back * least(back, x)); };
        Matrix drives(nv, int(std::count(driven.begin(), driven.end(), true)));
        for (int k = 0, n = 0; k < nv; ++k) {
            if (!driven[k]) continue;
            Vector unit(nv, 0.0);
            unit[k] = 1.0 / std::sqrt(share[k]);
            drives(n++) = allowed(unit);
        }
        const Vector wanted = allowed(tau), x = least(drives, wanted);
        if ((drives * x - wanted).normInf() > CARRIED * std::max(1.0, tau.normInf()))
            throw Refused("the drives cannot make this motion");
        Vector out(nv, 0.0);
        for (int k = 0, n = 0; k < nv; ++k) if (driven[k]) out[k] = x[n++] / std::sqrt(share[k]);
        return out;
    }
};

int main(int count, char** words) {
    if (count != 3) { std::cerr << "usage: answer KIT OUT\n"; return 2; }
    const std::string in = std::string(words[1]) + "/", out = std::string(words[2]) + "/";
    if (!std::ifstream(in + "case.json")) { std::cerr << in << " holds no case.json: expected a case kit\n"; return 2; }
    std::filesystem::create_directories(out);
    int version[3];
    SimTK_version_simbody(&version[0], &version[1], &version[2]);
    const json kit = json::parse(std::ifstream(in + "case.json"));
    json meta = {{"tool", "Simbody"}, {"case", kit["digest"]}, {"formulation", "calcResidualForceIgnoringConstraints, G"},
                 {"version", std::to_string(version[0]) + "." + std::to_string(version[1]) + "." + std::to_string(version[2])}};
    try {
        if (kit["case"]["integrated"].get<bool>()) throw Refused("this program integrates nothing in time: no beams, no joints without a motion");
        const Table motion(in + "motion.csv");
        Model model(kit);
        std::ofstream series(out + "series.csv");
        series.precision(17);
        json efforts;
        std::vector<int> index;
        series << "time [s]";
        for (const json& one : kit["case"]["asked"]) if (one["quantity"] == "torque") efforts = one["series"];
        for (int k = 0; k < model.velocities(); ++k) {
            const std::string name = "torque/" + kit["case"]["velocities"][k]["name"].get<std::string>();
            if (!efforts.is_null() && !efforts.contains(name)) continue;
            index.push_back(k);
            series << "," << name << " [" << kit["case"]["velocities"][k]["effort_unit"].get<std::string>() << "]";
        }
        for (const json& link : kit["mechanism"]["links"])
            for (char c : {'x', 'y', 'z'}) series << ",tip/" << link["name"].get<std::string>() << "/" << c << " [m]";
        series << "\n";
        const auto start = std::chrono::steady_clock::now();
        for (int row = 0; row < int(motion.rows.size()); ++row) {
            model.place(motion, row, true);
            const Vector tau = model.efforts();
            series << motion.rows[row][0];
            for (int k : index) series << "," << tau[k];
            for (const json& link : kit["mechanism"]["links"]) { const Vec3 p = model.tip(link); series << "," << p[0] << "," << p[1] << "," << p[2]; }
            series << "\n";
        }
        meta["wall_time"] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        std::ofstream(out + "certificate.json") << Model(kit).certificate(Table(in + "probe.csv"));
    } catch (const Refused& why) {
        std::remove((out + "series.csv").c_str());
        meta["skipped"] = why.what();
    } catch (const std::exception& error) {
        std::cerr << error.what() << "\n";
        return 1;
    }
    std::ofstream(out + "meta.json") << meta;
}

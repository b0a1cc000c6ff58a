// SPDX-License-Identifier: Apache-2.0
/// @file  Avatars in the extension module: handles as capsules, arrays that share their memory, and numbers of users as
///        whatever gives an array or is a sequence.

#include "posing_module.hpp"

#include "library_call.hpp"
#include "posing_interface.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <cstddef>
#include <cstring>
#include <initializer_list>
#include <string>
#include <vector>

namespace nb = nanobind;

namespace gsh_python {

namespace {

constexpr const char *avatar_name = "gsh.posing.avatar", *motion_name = "gsh.posing.motion",
                     *splats_name = "gsh.posing.splats";

const PosingApi& api() { return *gsh_python_posing_api(); }

/// Numbers that a user passed, as rows of doubles.
struct Numbers {
    std::vector<double> values;
    std::vector<std::int64_t> shape;

    [[nodiscard]] const double* data() const { return values.data(); }
};

[[nodiscard]] std::string text_of(const std::vector<std::int64_t>& shape) {
    std::string text = "[";
    for (const std::int64_t n : shape) text += (text.size() > 1 ? ", " : "") + (n < 0 ? "*" : std::to_string(n));
    return text + "]";
}

[[nodiscard]] std::string class_name(nb::handle object) {
    return nb::cast<std::string>(object.type().attr("__name__"));
}

/// Appends a sequence of numbers, or of such sequences, and finds its shape.
void flatten(nb::handle object, const std::string& name, std::size_t axis, Numbers& numbers) {
    if (nb::isinstance<nb::list>(object) || nb::isinstance<nb::tuple>(object)) {
        const auto count = static_cast<std::int64_t>(nb::len(object));
        if (axis == numbers.shape.size()) numbers.shape.push_back(count);
        else if (numbers.shape[axis] != count) raise(PyExc_ValueError, name + " has rows of different lengths");
        if (axis > 3) raise(PyExc_ValueError, name + " has too many axes");
        for (const nb::handle item : nb::borrow<nb::sequence>(object)) flatten(item, name, axis + 1, numbers);
        return;
    }
    if (axis != numbers.shape.size()) raise(PyExc_ValueError, name + " has rows of different lengths");
    const double value = nb::isinstance<nb::bool_>(object) ? -1 : PyFloat_AsDouble(object.ptr());
    if (nb::isinstance<nb::bool_>(object) || PyErr_Occurred() != nullptr) {
        PyErr_Clear();
        raise(PyExc_TypeError, name + " contains " + class_name(object) + ", expected numbers");
    }
    numbers.values.push_back(value);
}

template <class T>
void append(const nb::ndarray<nb::ro>& array, Numbers& numbers) {
    std::vector<std::int64_t> index(array.ndim(), 0);
    for (std::size_t i = 0; i < array.size(); ++i) {
        std::int64_t offset = 0;
        for (std::size_t a = 0; a < array.ndim(); ++a) offset += index[a] * array.stride(a);
        T value; // rows of a buffer need not be aligned
        std::memcpy(&value, static_cast<const char*>(array.data()) + offset * std::int64_t(sizeof(T)), sizeof(T));
        numbers.values.push_back(static_cast<double>(value));
        for (std::size_t a = array.ndim(); a-- > 0;) {
            if (++index[a] < static_cast<std::int64_t>(array.shape(a))) break;
            index[a] = 0;
        }
    }
}

/// Numbers of a user in this shape, in which -1 stands for any size; none for None.
/// Errors  TypeError, ValueError naming the argument.
[[nodiscard]] Numbers numbers_of(nb::handle object, const std::string& name, std::vector<std::int64_t> shape) {
    Numbers numbers;
    if (object.is_none()) return numbers;
    nb::ndarray<nb::ro> array;
    if (nb::isinstance<nb::list>(object) || nb::isinstance<nb::tuple>(object)) {
        flatten(object, name, 0, numbers);
    } else if (nb::try_cast(object, array)) {
        if (array.device_type() != nb::device::cpu::value)
            raise(PyExc_ValueError, name + " is not in the memory of the CPU; copy it there first");
        for (std::size_t a = 0; a < array.ndim(); ++a)
            numbers.shape.push_back(static_cast<std::int64_t>(array.shape(a)));
        if (array.dtype() == nb::dtype<float>()) append<float>(array, numbers);
        else if (array.dtype() == nb::dtype<double>()) append<double>(array, numbers);
        else
            raise(PyExc_TypeError, name + " is an array of other numbers than float32 and float64 (type " +
                                       class_name(object) + "); convert it");
    } else {
        PyErr_Clear();
        raise(PyExc_TypeError, name + " is " + class_name(object) +
                                   ", expected an array (by DLPack or the buffer protocol) or a list of numbers; "
                                   "of a tensor that needs a gradient, pass .detach()");
    }
    bool fits = numbers.shape.size() == shape.size();
    for (std::size_t a = 0; fits && a < shape.size(); ++a) fits = shape[a] < 0 || shape[a] == numbers.shape[a];
    if (!fits)
        raise(PyExc_ValueError, name + " has the shape " + text_of(numbers.shape) + ", expected " + text_of(shape));
    for (std::size_t i = 0; i < numbers.values.size(); ++i) {
        if (std::isfinite(numbers.values[i])) continue;
        std::string index;
        std::size_t rest = i;
        for (std::size_t a = numbers.shape.size(); a-- > 0;) {
            const auto n = static_cast<std::size_t>(numbers.shape[a]);
            index = std::to_string(rest % n) + (index.empty() ? "" : ", ") + index;
            rest /= n;
        }
        raise(PyExc_ValueError, name + "[" + index + "] is " + (std::isnan(numbers.values[i]) ? "nan" : "infinite") +
                                    ", expected a finite number");
    }
    return numbers;
}

/// An array in memory that the capsule keeps.
template <class T>
[[nodiscard]] nb::object view(T* data, std::initializer_list<std::int64_t> shape, nb::handle owner) {
    std::vector<std::size_t> sizes;
    for (const std::int64_t n : shape) sizes.push_back(static_cast<std::size_t>(n));
    static std::remove_const_t<T> nothing{};
    T* const memory = data != nullptr ? data : &nothing; // of an array without elements
    return nb::cast(nb::ndarray<nb::array_api, T, nb::c_contig, nb::device::cpu>(memory, sizes.size(), sizes.data(),
                                                                                 owner));
}

/// A new array of float32, and its memory.
struct NewImage {
    nb::object array;
    float* data = nullptr;

    NewImage() : array(nb::none()) {}
    explicit NewImage(std::initializer_list<std::int64_t> shape) {
        std::size_t count = 1;
        for (const std::int64_t n : shape) count *= static_cast<std::size_t>(n);
        data = new float[count];
        const nb::capsule owner(data, [](void* memory) noexcept { delete[] static_cast<float*>(memory); });
        array = view(data, shape, owner);
    }
};

template <class Handle>
[[nodiscard]] Handle& handle_of(const nb::capsule& capsule, const char* name) {
    return *static_cast<Handle*>(capsule.data(name));
}
[[nodiscard]] AvatarHandle& avatar_of(const nb::capsule& c) { return handle_of<AvatarHandle>(c, avatar_name); }
[[nodiscard]] MotionHandle& motion_of(const nb::capsule& c) { return handle_of<MotionHandle>(c, motion_name); }
[[nodiscard]] SplatsHandle& splats_of(const nb::capsule& c) { return handle_of<SplatsHandle>(c, splats_name); }

[[nodiscard]] Texts texts(std::vector<std::string>& list) {
    return {&list, [](void* to, const char* text) { static_cast<std::vector<std::string>*>(to)->emplace_back(text); }};
}

/// Texts of files, which need not be UTF-8.
[[nodiscard]] nb::list list_of(const std::vector<std::string>& texts) {
    nb::list list;
    for (const std::string& text : texts)
        list.append(nb::steal(PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "replace")));
    return list;
}

nb::capsule load_avatar(const std::string& path, int threads) {
    AvatarHandle* avatar = nullptr;
    run([&] { return api().load_avatar(path.c_str(), threads, &avatar); });
    return nb::capsule(avatar, avatar_name,
                       [](void* p) noexcept { api().release_avatar(static_cast<AvatarHandle*>(p)); });
}

nb::dict avatar_info(const nb::capsule& avatar) {
    const AvatarInfo a = api().avatar_info(avatar_of(avatar));
    const std::int64_t N = a.gaussians, K = (a.sh_degree + 1) * (a.sh_degree + 1);
    std::vector<std::string> names;
    api().joint_names(avatar_of(avatar), texts(names));
    nb::dict info;
    info["expressions"] = a.expressions;
    info["lit"] = a.lit != 0;
    info["joint_names"] = nb::tuple(list_of(names));
    info["parents"] = view(a.parents, {a.joints}, avatar);
    info["rest_joints"] = view(a.rest_joints, {a.joints, 3}, avatar);
    info["betas"] = view(a.shape, {a.betas}, avatar);
    info["means"] = view(a.means, {N, 3}, avatar);
    info["quats"] = view(a.quats, {N, 4}, avatar);
    info["log_scales"] = view(a.log_scales, {N, 3}, avatar);
    info["opacity_logits"] = view(a.opacity_logits, {N}, avatar);
    info["sh"] = view(a.sh, {N, K, 3}, avatar);
    return info;
}

/// The motion, and warnings.
nb::tuple load_motion(const nb::capsule& avatar, const std::string& path, bool upright, double input_fps,
                      const std::string& animation) {
    const AvatarHandle& a = avatar_of(avatar);
    MotionHandle* motion = nullptr;
    std::vector<std::string> warnings;
    run([&] {
        return api().load_motion(a, path.c_str(), upright, input_fps, animation.c_str(), texts(warnings), &motion);
    });
    const nb::capsule capsule(motion, motion_name,
                              [](void* p) noexcept { api().release_motion(static_cast<MotionHandle*>(p)); });
    return nb::make_tuple(capsule, list_of(warnings));
}

nb::dict motion_info(const nb::capsule& motion) {
    const MotionInfo m = api().motion_info(motion_of(motion));
    nb::dict info;
    info["pose"] = view(m.pose, {m.frames, m.joints, 3}, motion);
    info["transl"] = view(m.transl, {m.frames, 3}, motion);
    info["expression"] = view(m.expression, {m.frames, m.expressions}, motion);
    info["betas"] = view(m.shape, {m.betas}, motion);
    info["timestamps"] = view(m.timestamps, {m.frames}, motion);
    return info;
}

nb::capsule make_splats(const nb::capsule& avatar) {
    SplatsHandle* splats = nullptr;
    run([&] { return api().make_splats(avatar_of(avatar), &splats); });
    return nb::capsule(splats, splats_name,
                       [](void* p) noexcept { api().release_splats(static_cast<SplatsHandle*>(p)); });
}

nb::dict splats_info(const nb::capsule& splats) {
    const SplatsInfo s = api().splats_info(splats_of(splats));
    nb::dict info;
    info["means"] = view(s.means, {s.gaussians, 3}, splats);
    info["covariances"] = view(s.covariances, {s.gaussians, 6}, splats);
    info["opacities"] = view(s.opacities, {s.gaussians}, splats);
    info["colors"] = view(s.colors, {s.gaussians, 3}, splats);
    return info;
}

/// A camera as (width, height, K, R, t), the last three of 9, 9 and 3 numbers.
[[nodiscard]] CameraNumbers camera_of(const nb::tuple& camera) {
    CameraNumbers numbers{};
    numbers.width = nb::cast<int>(camera[0]), numbers.height = nb::cast<int>(camera[1]);
    const auto copy = [&](std::size_t member, double* to, std::size_t count) {
        const nb::tuple from = nb::cast<nb::tuple>(camera[member]);
        if (from.size() != count) raise(PyExc_ValueError, "the camera has matrices of another size");
        for (std::size_t i = 0; i < count; ++i) to[i] = nb::cast<double>(from[i]);
    };
    copy(2, numbers.K, 9), copy(3, numbers.R, 9), copy(4, numbers.t, 3);
    return numbers;
}

[[nodiscard]] nb::tuple tuple_of(const CameraNumbers& c) {
    const auto numbers = [](const double* from, std::size_t count) {
        nb::list list;
        for (std::size_t i = 0; i < count; ++i) list.append(from[i]);
        return nb::tuple(list);
    };
    return nb::make_tuple(c.width, c.height, numbers(c.K, 9), numbers(c.R, 9), numbers(c.t, 3));
}

void pose_frame(const nb::capsule& splats, const nb::capsule& motion, std::int64_t frame, nb::object camera,
                nb::object center) {
    SplatsHandle& s = splats_of(splats);
    const MotionHandle& m = motion_of(motion);
    const CameraNumbers numbers = camera.is_none() ? CameraNumbers{} : camera_of(nb::cast<nb::tuple>(camera));
    const Numbers point = numbers_of(center, "Avatar.pose: center", {3});
    run([&] { return api().pose(s, &m, frame, {}, camera.is_none() ? nullptr : &numbers, point.data()); });
}

void pose_numbers(const nb::capsule& splats, const nb::capsule& avatar, nb::object pose, nb::object transl,
                  nb::object expression, nb::object betas, nb::object camera, nb::object center) {
    SplatsHandle& s = splats_of(splats);
    const AvatarInfo a = api().avatar_info(avatar_of(avatar));
    const CameraNumbers numbers = camera.is_none() ? CameraNumbers{} : camera_of(nb::cast<nb::tuple>(camera));
    const Numbers point = numbers_of(center, "Avatar.pose: center", {3});
    const Numbers p = numbers_of(pose, "Avatar.pose: pose", {a.joints, 3});
    const Numbers t = numbers_of(transl, "Avatar.pose: transl", {3});
    const Numbers e = numbers_of(expression, "Avatar.pose: expression", {-1});
    const Numbers b = numbers_of(betas, "Avatar.pose: betas", {-1});
    const auto limit = [](const Numbers& given, const char* name, std::int64_t most) {
        if (!given.shape.empty() && given.shape[0] > most)
            raise(PyExc_ValueError, std::string("Avatar.pose: ") + name + " has " + std::to_string(given.shape[0]) +
                                        " numbers, the avatar has " + std::to_string(most));
    };
    limit(e, "expression", a.expressions), limit(b, "betas", a.betas);
    const auto or_null = [](const Numbers& n) { return n.values.empty() ? nullptr : n.data(); };
    const PoseNumbers one{or_null(p), a.joints, or_null(t), or_null(e), static_cast<std::int64_t>(e.values.size()),
                          or_null(b), static_cast<std::int64_t>(b.values.size())};
    run([&] { return api().pose(s, nullptr, 0, one, camera.is_none() ? nullptr : &numbers, point.data()); });
}

/// color, alpha, and with `depths` expected and median depth.
nb::tuple render(const std::vector<nb::capsule>& splats, const nb::tuple& camera, nb::object background, bool depths) {
    std::vector<SplatsHandle*> handles;
    for (const nb::capsule& one : splats) handles.push_back(&splats_of(one));
    const CameraNumbers numbers = camera_of(camera);
    const Numbers color = numbers_of(background, "render: background", {3});
    const float behind[3] = {static_cast<float>(color.values[0]), static_cast<float>(color.values[1]),
                             static_cast<float>(color.values[2])};
    run([&] { return api().check_camera(numbers); }); // before its size becomes memory
    const std::int64_t h = numbers.height, w = numbers.width;
    const NewImage picture({h, w, 3}), alpha({h, w});
    const NewImage expected = depths ? NewImage({h, w}) : NewImage(), median = depths ? NewImage({h, w}) : NewImage();
    run([&] {
        return api().render(handles.data(), static_cast<std::int64_t>(handles.size()), numbers, behind,
                            {picture.data, alpha.data, expected.data, median.data});
    });
    return nb::make_tuple(picture.array, alpha.array, expected.array, median.array);
}

nb::tuple read_camera(const std::string& path, const std::string& name) {
    CameraNumbers camera{};
    run([&] { return api().read_camera(path.c_str(), name.c_str(), &camera); });
    return tuple_of(camera);
}

nb::tuple check_camera(int width, int height, nb::object K, nb::object R, nb::object t) {
    CameraNumbers camera{};
    camera.width = width, camera.height = height;
    const auto copy = [](nb::object from, const char* name, std::vector<std::int64_t> shape, double* to) {
        const Numbers numbers = numbers_of(from, std::string("Camera: ") + name, std::move(shape));
        if (numbers.values.empty()) raise(PyExc_TypeError, std::string("Camera: ") + name + " is None");
        for (std::size_t i = 0; i < numbers.values.size(); ++i) to[i] = numbers.values[i];
    };
    copy(K, "K", {3, 3}, camera.K), copy(R, "R", {3, 3}, camera.R), copy(t, "t", {3}, camera.t);
    run([&] { return api().check_camera(camera); });
    return tuple_of(camera);
}

nb::tuple look_at(nb::object eye, nb::object target, nb::object up, double vertical_fov, int width, int height) {
    CameraNumbers camera{};
    camera.width = width, camera.height = height;
    const Numbers e = numbers_of(eye, "Camera.look_at: eye", {3}),
                  at = numbers_of(target, "Camera.look_at: target", {3}), u = numbers_of(up, "Camera.look_at: up", {3});
    for (const Numbers* vector : {&e, &at, &u})
        if (vector->values.empty()) raise(PyExc_TypeError, "Camera.look_at: eye, target and up must not be None");
    run([&] { return api().look_at(e.data(), at.data(), u.data(), vertical_fov, &camera); });
    return tuple_of(camera);
}

} // namespace

void add_posing_functions(nb::module_& module) {
    nb::module_ m = module.def_submodule("posing");
    m.def("load_avatar", &load_avatar, nb::arg("path"), nb::arg("threads"));
    m.def("avatar_info", &avatar_info, nb::arg("avatar"));
    m.def("load_motion", &load_motion, nb::arg("avatar"), nb::arg("path"), nb::arg("upright"), nb::arg("input_fps"),
          nb::arg("animation"));
    m.def("motion_info", &motion_info, nb::arg("motion"));
    m.def("make_splats", &make_splats, nb::arg("avatar"));
    m.def("splats_info", &splats_info, nb::arg("splats"));
    m.def("pose_frame", &pose_frame, nb::arg("splats"), nb::arg("motion"), nb::arg("frame"), nb::arg("camera").none(),
          nb::arg("center").none());
    m.def("pose_numbers", &pose_numbers, nb::arg("splats"), nb::arg("avatar"), nb::arg("pose").none(),
          nb::arg("transl").none(), nb::arg("expression").none(), nb::arg("betas").none(), nb::arg("camera").none(),
          nb::arg("center").none());
    m.def("render", &render, nb::arg("splats"), nb::arg("camera"), nb::arg("background"), nb::arg("depths"));
    m.def("read_camera", &read_camera, nb::arg("path"), nb::arg("name"));
    m.def("check_camera", &check_camera, nb::arg("width"), nb::arg("height"), nb::arg("K").none(),
          nb::arg("R").none(), nb::arg("t").none());
    m.def("look_at", &look_at, nb::arg("eye").none(), nb::arg("target").none(), nb::arg("up").none(),
          nb::arg("vertical_fov"), nb::arg("width"), nb::arg("height"));
}

} // namespace gsh_python

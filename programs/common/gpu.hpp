// SPDX-License-Identifier: Apache-2.0
/// @file  What the programs run on a GPU. The files *.cu define it; in a program without CUDA, without_cuda.cpp does.
#pragma once

#include <gsh/backend/threads.hpp>

#include <cstdint>
#include <memory>
#include <string>

namespace gsh {
class AnyReconstruction;
class AnyStaticReconstruction;
struct Observer;
struct PixelFilter;
struct Recipe;
struct ReconstructionInput;
struct ReconstructionSetup;
struct StaticSetup;
namespace cuda {
class Device;
}
template <class T>
struct GaussianCloud;
} // namespace gsh

namespace gsh::programs {

class Renderer;
struct ShownPeople;

/// Whether the program was built with CUDA.
[[nodiscard]] bool has_cuda();

/// Opens GPU `number`, counted from 0 as in CUDA_VISIBLE_DEVICES; `mixed`: fields compute in mixed precision.
/// Errors  DeviceError: a program without CUDA, no driver, no such GPU, no code for its architecture.
std::shared_ptr<cuda::Device> open_gpu(int number, bool mixed);

/// The name of a GPU.
std::string name_of(const cuda::Device& gpu);

/// The most bytes that gsh has taken of its memory.
std::uint64_t peak_memory_of(const cuda::Device& gpu);

/// register_people on a GPU.
void register_on(cuda::Device& gpu, cpu::Threads& host, ReconstructionInput& input, const Recipe& recipe,
                 const Observer& observer);

/// What make_reconstruction, make_static_reconstruction and make_renderer return for a machine with a GPU. `gpu` must
/// outlive the result, and so must what make_… requires to.
std::unique_ptr<AnyReconstruction> reconstruction_on(cuda::Device& gpu, ReconstructionSetup&& setup);
std::unique_ptr<AnyStaticReconstruction> static_reconstruction_on(cuda::Device& gpu, StaticSetup&& setup);
std::unique_ptr<Renderer> renderer_on(cuda::Device& gpu, const ShownPeople& people);
std::unique_ptr<Renderer> renderer_on(cuda::Device& gpu, const GaussianCloud<float>& scene, const PixelFilter& filter);

} // namespace gsh::programs

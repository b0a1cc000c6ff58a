// SPDX-License-Identifier: Apache-2.0
/// The functions of gpu.hpp in a program without CUDA. No GPU can be opened, so the others are never called.
#include "common/gpu.hpp"

#include <gsh/core/error.hpp>

namespace gsh::programs {

namespace {

[[noreturn]] void refuse_cuda() {
    throw DeviceError("--backend cuda: this program was built without CUDA; configure with nvcc in PATH (GSH_CUDA) and "
                      "-D GSH_PROGRAMS_CUDA=ON, or leave the option out to compute on the CPU");
}

} // namespace

bool has_cuda() {
    return false;
}
std::shared_ptr<cuda::Device> open_gpu(int, bool) {
    refuse_cuda();
}
std::string name_of(const cuda::Device&) {
    refuse_cuda();
}
std::uint64_t peak_memory_of(const cuda::Device&) {
    refuse_cuda();
}
void register_on(cuda::Device&, cpu::Threads&, ReconstructionInput&, const Recipe&, const Observer&) {
    refuse_cuda();
}
std::unique_ptr<AnyReconstruction> reconstruction_on(cuda::Device&, ReconstructionSetup&&) {
    refuse_cuda();
}
std::unique_ptr<AnyStaticReconstruction> static_reconstruction_on(cuda::Device&, StaticSetup&&) {
    refuse_cuda();
}
std::unique_ptr<Renderer> renderer_on(cuda::Device&, const ShownPeople&) {
    refuse_cuda();
}
std::unique_ptr<Renderer> renderer_on(cuda::Device&, const GaussianCloud<float>&, const PixelFilter&) {
    refuse_cuda();
}

} // namespace gsh::programs

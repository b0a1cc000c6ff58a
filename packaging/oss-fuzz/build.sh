#!/bin/bash -eu
# Builds gsh-fuzz for OSS-Fuzz, which sets CC, CXX, CFLAGS, CXXFLAGS, LIB_FUZZING_ENGINE, SRC, WORK and OUT. In OUT each
# target is fuzz-NAME, with its seeds and its dictionary. Run it in a checkout of gsh.

# The distribution's C++ libraries (oneTBB, tinygltf) are compiled for libstdc++.
export CXXFLAGS="${CXXFLAGS//-stdlib=libc++/}"

mkdir -p "$WORK" "$OUT"
if [ -d "${SRC:-}/cpp-httplib" ]; then
  cmake -S "$SRC/cpp-httplib" -B "$WORK/cpp-httplib" -G Ninja -DCMAKE_INSTALL_PREFIX="$WORK/usr" \
    -DHTTPLIB_COMPILE=OFF -DHTTPLIB_USE_OPENSSL_IF_AVAILABLE=OFF -DHTTPLIB_USE_BROTLI_IF_AVAILABLE=OFF
  cmake --install "$WORK/cpp-httplib"
  # Headers alone come without a file for pkg-config.
  mkdir -p "$WORK/usr/lib/pkgconfig"
  printf 'Name: cpp-httplib\nDescription: HTTP\nVersion: 0.11.4\nCflags: -I%s/usr/include\nLibs: -lpthread\n' "$WORK" \
    >"$WORK/usr/lib/pkgconfig/cpp-httplib.pc"
  export PKG_CONFIG_PATH="$WORK/usr/lib/pkgconfig:${PKG_CONFIG_PATH:-}"
fi

# Sanitizers and coverage come with CXXFLAGS. Instruction sets are those of any x86-64 processor.
cmake -S . -B "$WORK/gsh" -G Ninja -DCMAKE_BUILD_TYPE=RelWithDebInfo \
  -DCMAKE_C_COMPILER="$CC" -DCMAKE_CXX_COMPILER="$CXX" -DCMAKE_CXX_FLAGS="$CXXFLAGS -D_GLIBCXX_ASSERTIONS" \
  -DCMAKE_CXX_FLAGS_RELWITHDEBINFO= -DGSH_FUZZ_ENGINE="$LIB_FUZZING_ENGINE" -DGSH_BUILD_FUZZ=ON \
  -DGSH_BUILD_TESTS=OFF -DGSH_BUILD_EXAMPLES=OFF -DGSH_BUILD_BENCH=OFF -DGSH_INSTALL=OFF -DGSH_WERROR=OFF \
  -DGSH_NATIVE=OFF -DGSH_REQUIRE_COMPONENTS=OFF -DGSH_JOIN_SOURCES=ON
cmake --build "$WORK/gsh" --target gsh-fuzz

# The libraries that the image in which targets run does not have.
mkdir -p "$OUT/lib"
ldd "$WORK/gsh/bin/gsh-fuzz" | awk '$2 == "=>" && $3 ~ /^\// { print $3 }' |
  grep -vE '/(libc|libm|libdl|libpthread|librt|libresolv|libgcc_s|ld-linux[^/]*)\.so' |
  while IFS= read -r library; do cp -L "$library" "$OUT/lib/"; done
patchelf --set-rpath '$ORIGIN/lib' --force-rpath "$WORK/gsh/bin/gsh-fuzz"
for library in "$OUT"/lib/*; do patchelf --set-rpath '$ORIGIN' --force-rpath "$library"; done

# One program has all targets; its name chooses one. A hard link takes no further space where OUT supports it.
first=
for target in $("$WORK/gsh/bin/gsh-fuzz"); do
  program=$OUT/fuzz-$target
  if [ -n "$first" ]; then
    ln -f "$first" "$program" 2>/dev/null || cp "$first" "$program"
  else
    cp "$WORK/gsh/bin/gsh-fuzz" "$program"
    first=$program
  fi
  printf '[libfuzzer]\ntimeout = 5\nmalloc_limit_mb = 256\n' >"$program.options"
  if [ -d "tests/fuzz/corpus/$target" ]; then
    rm -f "${program}_seed_corpus.zip"
    zip -q -j "${program}_seed_corpus.zip" "tests/fuzz/corpus/$target"/*
  fi
  if [ -f "tests/fuzz/dictionaries/$target.dict" ]; then cp "tests/fuzz/dictionaries/$target.dict" "$program.dict"; fi
done

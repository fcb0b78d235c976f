"""Conan 2 recipe that builds the repository it lies in, with the Rust that is installed:

    conan create ffi/packaging/conan

`-c user.svbrdf:built=FOLDER` takes a library that was built before, e.g. target/release.
"""
import os
import re

from conan import ConanFile
from conan.errors import ConanInvalidConfiguration
from conan.tools.files import copy, load, rm, rmdir

NOT_NEEDED = ["target/*", "data/*", ".git/*", "android-example/*", "training/*", "docs/*", "fuzz/*"]


class SvbrdfConan(ConanFile):
    name = "svbrdf"
    description = "Normal, diffuse, specular and roughness maps of a flat material from a few flash photographs"
    license = "MIT OR Apache-2.0"
    homepage = "https://github.com/svbrdf/svbrdf"
    settings = "os", "arch", "compiler", "build_type"
    options = {"shared": [True, False], "models": [True, False]}
    default_options = {"shared": True, "models": True}

    def _repository(self):
        return os.path.join(self.recipe_folder, "..", "..", "..")

    def set_version(self):
        manifest = load(self, os.path.join(self._repository(), "Cargo.toml"))
        self.version = re.search(r'\[workspace\.package\]\nversion = "(.+)"', manifest).group(1)

    def export_sources(self):
        copy(self, "*", self._repository(), self.export_sources_folder, excludes=NOT_NEEDED)

    def configure(self):
        # A C interface: the compiler's C++ library does not matter.
        self.settings.rm_safe("compiler.cppstd")
        self.settings.rm_safe("compiler.libcxx")

    def package_id(self):
        # One build serves programs that are debugged and those that are not.
        del self.info.settings.build_type
        del self.info.settings.compiler

    def validate(self):
        if self.settings.os not in ("Linux", "Macos"):
            raise ConanInvalidConfiguration("ffi/install.sh knows Linux and macOS")

    def _built(self):
        given = self.conf.get("user.svbrdf:built", check_type=str)
        return given or os.path.join(self.build_folder, "target", "dist")

    def build(self):
        if self.conf.get("user.svbrdf:built", check_type=str):
            return
        options = "" if self.options.models else " --no-default-features"
        target = os.path.join(self.build_folder, "target")
        self.run(
            f'CARGO_TARGET_DIR="{target}" cargo build --locked --profile dist -p svbrdf-ffi{options}',
            cwd=self.source_folder,
        )

    def package(self):
        self.run(f'SVBRDF_BUILT="{self._built()}" ffi/install.sh "{self.package_folder}"', cwd=self.source_folder)
        library = os.path.join(self.package_folder, "lib")
        for pattern in ["*.a"] if self.options.shared else ["*.so*", "*.dylib"]:
            rm(self, pattern, library)
        # Conan's generators write their own.
        rmdir(self, os.path.join(library, "cmake"))
        rmdir(self, os.path.join(library, "pkgconfig"))
        licences = os.path.join(self.package_folder, "licenses")
        copy(self, "LICENSE-*", self.source_folder, licences)

    def package_info(self):
        self.cpp_info.libs = ["svbrdf"]
        target = "svbrdf::svbrdf" if self.options.shared else "svbrdf::svbrdf-static"
        self.cpp_info.set_property("cmake_target_name", target)
        if not self.options.shared and self.settings.os == "Linux":
            self.cpp_info.system_libs = ["pthread", "dl", "m"]
